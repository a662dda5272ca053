#include "hal/linux/socketcan_bus.hpp"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <system_error>
#include <utility>

#include "hal/linux/monotonic_clock.hpp"

namespace wheelwright::hal {

namespace {

std::int64_t read_clock_ns(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

std::string reason(int error) { return std::generic_category().message(error); }

Error socket_error(int error) {
    switch (error) {
        case EAFNOSUPPORT:
            return {
                "This kernel has no CAN; load it with `modprobe can`, or use a kernel that has CONFIG_CAN."};
        case EPROTONOSUPPORT:
            return {"This kernel has no raw CAN sockets; load them with `modprobe can_raw`."};
        case EPERM:
        case EACCES:
            return {
                "No permission to open a CAN socket; allow the address family AF_CAN (a container or a "
                "service may forbid it), or run as root."};
        default:
            return {"Cannot open a CAN socket: " + reason(error) + "."};
    }
}

// Closes the socket on every early return.
class OpenSocket {
  public:
    explicit OpenSocket(int socket) : socket_(socket) {}
    ~OpenSocket() {
        if (socket_ >= 0) {
            ::close(socket_);
        }
    }
    OpenSocket(const OpenSocket&) = delete;
    OpenSocket& operator=(const OpenSocket&) = delete;

    int get() const { return socket_; }
    int release() {
        const int socket = socket_;
        socket_ = -1;
        return socket;
    }

  private:
    int socket_;
};

template <typename T>
bool set_option(int socket, int level, int name, const T& value) {
    return setsockopt(socket, level, name, &value, sizeof value) == 0;
}

}  // namespace

Result<std::unique_ptr<SocketCanBus>> SocketCanBus::open(const std::string& interface,
                                                         const SocketCanOptions& options) {
    ifreq request{};
    if (interface.empty() || interface.size() >= sizeof request.ifr_name) {
        return Error{
            "\"" + interface + "\" cannot be the name of a network interface; give one such as can0.",
            Error::Kind::usage};
    }
    const auto ask = [&](int socket, unsigned long question) {
        request = ifreq{};
        std::copy(interface.begin(), interface.end(), std::begin(request.ifr_name));
        return ioctl(socket, question, &request) == 0;
    };

    OpenSocket socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
    if (socket.get() < 0) {
        return socket_error(errno);
    }
    if (!ask(socket.get(), SIOCGIFINDEX)) {
        if (errno != ENODEV) {
            return Error{"Cannot look up " + interface + ": " + reason(errno) + "."};
        }
        return Error{"There is no interface " + interface +
                     "; `ip link` lists those there are, and `ip link add dev " + interface +
                     " type vcan` makes a virtual one."};
    }
    const int index = request.ifr_ifindex;
    if (ask(socket.get(), SIOCGIFHWADDR) && request.ifr_hwaddr.sa_family != ARPHRD_CAN) {
        return Error{interface +
                         " is not a CAN interface; `ip link show type can` and `ip link show type vcan` "
                         "list those.",
                     Error::Kind::usage};
    }
    if (ask(socket.get(), SIOCGIFFLAGS) && (request.ifr_flags & IFF_UP) == 0) {
        return Error{"The interface " + interface + " is down; bring it up with `ip link set " + interface +
                     " up type can bitrate 1000000` (a virtual one with `ip link set " + interface +
                     " up`)."};
    }
    const bool fd_interface = ask(socket.get(), SIOCGIFMTU) && request.ifr_mtu >= int{CANFD_MTU};

    // Not fatal: without them there are no error frames, no overflow count, or stamps taken by ourselves.
    const can_err_mask_t all_errors = CAN_ERR_MASK;
    set_option(socket.get(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, all_errors);
    set_option(socket.get(), SOL_SOCKET, SO_RXQ_OVFL, int{1});
    set_option(socket.get(), SOL_SOCKET, SO_TIMESTAMPNS, int{1});
    if (!set_option(socket.get(), SOL_SOCKET, SO_RCVBUFFORCE, options.receive_buffer_bytes)) {
        set_option(socket.get(), SOL_SOCKET, SO_RCVBUF, options.receive_buffer_bytes);
    }
    set_option(socket.get(), SOL_SOCKET, SO_SNDBUF, options.send_buffer_bytes);
    const bool confirms = set_option(socket.get(), SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, int{1});
    const bool fd_frames = fd_interface && set_option(socket.get(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, int{1});

    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = index;
    // The sockets interface wants this cast.
    if (bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
        return Error{"Cannot use " + interface + ": " + reason(errno) + "."};
    }
    std::unique_ptr<SocketCanBus> bus(new SocketCanBus(socket.release()));
    bus->fd_frames_ = fd_frames;
    bus->confirms_ = confirms;
    bus->realtime_offset_ns_ = realtime_offset_ns();
    return bus;
}

SocketCanBus::SocketCanBus(int socket) : socket_(socket) {
    for (std::size_t i = 0; i < batch; ++i) {
        pieces_[i] = {&incoming_[i].raw, sizeof incoming_[i].raw};
        messages_[i] = mmsghdr{};
        messages_[i].msg_hdr.msg_iov = &pieces_[i];
        messages_[i].msg_hdr.msg_iovlen = 1;
        messages_[i].msg_hdr.msg_control = incoming_[i].control.data();
        messages_[i].msg_hdr.msg_controllen = incoming_[i].control.size();
    }
}

SocketCanBus::~SocketCanBus() { ::close(socket_); }

CanStatus SocketCanBus::send(const CanFrame& frame) {
    CanStatus status = CanStatus::ok;
    if (bus_off_) {
        status = CanStatus::bus_down;
    } else if (!is_sendable(frame, fd_frames_)) {
        status = CanStatus::invalid;
    } else {
        canfd_frame raw{};  // its first 16 bytes are a can_frame
        raw.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0U) | (frame.remote ? CAN_RTR_FLAG : 0U);
        raw.len = frame.length;
        if (frame.fd && frame.bit_rate_switch) {
            raw.flags = CANFD_BRS;
        }
        if (!frame.remote) {
            std::memcpy(raw.data, frame.data.data(), frame.length);
        }
        const std::size_t size = frame.fd ? CANFD_MTU : CAN_MTU;
        ssize_t written = -1;
        do {
            written = ::send(socket_, &raw, size, MSG_DONTWAIT | MSG_NOSIGNAL);
        } while (written < 0 && errno == EINTR);
        if (written >= 0) {
            note_sent(raw.can_id);
        } else {
            switch (errno) {
                case ENOBUFS:  // the interface's queue is full
                case EAGAIN:   // the socket's share of it is
                    status = CanStatus::would_block;
                    break;
                case EINVAL:
                case EMSGSIZE:
                    status = CanStatus::invalid;
                    break;
                default:  // ENETDOWN, ENXIO, ENODEV: down, or gone
                    status = CanStatus::bus_down;
                    note_down(errno);
                    break;
            }
        }
    }
    if (status == CanStatus::ok) {
        down_ = false;
        ++statistics_.frames_sent;
    } else {
        ++statistics_.send_refused;
    }
    return status;
}

void SocketCanBus::note_sent(std::uint32_t raw_id) {
    bool confirmed = confirms_ && accept_all_;
    for (std::size_t i = 0; confirms_ && !confirmed && i < filter_count_; ++i) {
        confirmed = ((raw_id ^ filters_[i].can_id) & filters_[i].can_mask) == 0;
    }
    if (!confirmed) return;
    if (unconfirmed_count_ == unconfirmed_.size()) {
        unconfirmed_first_ = (unconfirmed_first_ + 1) % unconfirmed_.size();
        --unconfirmed_count_;
    }
    unconfirmed_[(unconfirmed_first_ + unconfirmed_count_++) % unconfirmed_.size()] = raw_id;
}

// Those sent before it have left as well, or never will.
void SocketCanBus::note_confirmed(std::uint32_t raw_id) {
    for (std::size_t i = 0; i < unconfirmed_count_; ++i) {
        const std::size_t at = (unconfirmed_first_ + i) % unconfirmed_.size();
        if (unconfirmed_[at] != raw_id) continue;
        unconfirmed_first_ = (at + 1) % unconfirmed_.size();
        unconfirmed_count_ -= i + 1;
        return;
    }
}

bool SocketCanBus::waits(std::uint32_t id) const {
    for (std::size_t i = 0; i < unconfirmed_count_; ++i) {
        if (unconfirmed_[(unconfirmed_first_ + i) % unconfirmed_.size()] == id) return true;
    }
    return false;
}

// Many frames in one system call: it costs more than all that is done with a frame.
bool SocketCanBus::take_waiting() {
    for (std::size_t i = 0; i < waiting_; ++i) {  // the kernel has put in how much it wrote
        messages_[i].msg_hdr.msg_controllen = incoming_[i].control.size();
    }
    next_ = 0;
    waiting_ = 0;
    int taken = -1;
    // When the interface goes down the socket says so once, before the frames that still wait.
    for (int attempt = 0; attempt < 2; ++attempt) {
        taken = recvmmsg(socket_, messages_.data(), batch, MSG_DONTWAIT, nullptr);
        if (taken >= 0 || (errno != ENETDOWN && errno != ENODEV && errno != EINTR)) {
            break;
        }
        if (errno != EINTR) note_down(errno);
    }
    if (taken <= 0) {
        return false;
    }
    waiting_ = static_cast<std::size_t>(taken);
    emptied_ = waiting_ < batch;
    return true;
}

CanStatus SocketCanBus::receive(ReceivedFrame& out) {
    for (;; ++next_) {
        // A batch that was not full has emptied the queue: to ask at once again would be a call for nothing.
        if (next_ == waiting_ && (std::exchange(emptied_, false) || !take_waiting())) {
            clocks_read_ = false;
            return down_ || bus_off_ ? CanStatus::bus_down : CanStatus::would_block;
        }
        if ((messages_[next_].msg_hdr.msg_flags & MSG_CONFIRM) == 0) break;
        note_confirmed(incoming_[next_].raw.can_id);
    }
    const canfd_frame& raw = incoming_[next_].raw;
    const std::size_t size = messages_[next_].msg_len;
    msghdr& message = messages_[next_].msg_hdr;
    ++next_;

    bool stamped = false;
    for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part)) {
        if (part->cmsg_level != SOL_SOCKET) {
            continue;
        }
        if (part->cmsg_type == SO_TIMESTAMPNS) {
            timespec stamp{};
            std::memcpy(&stamp, CMSG_DATA(part), sizeof stamp);
            out.timestamp_ns = to_monotonic_ns(std::int64_t{stamp.tv_sec} * 1'000'000'000 + stamp.tv_nsec);
            stamped = true;
        } else if (part->cmsg_type == SO_RXQ_OVFL) {
            std::uint32_t count = 0;
            std::memcpy(&count, CMSG_DATA(part), sizeof count);
            statistics_.receive_overflow += count - last_overflow_;  // modulo 2^32
            if (count != last_overflow_) unconfirmed_count_ = 0;     // confirmations may be among the lost
            last_overflow_ = count;
        }
    }
    if (!stamped) {
        out.timestamp_ns = read_clock_ns(CLOCK_MONOTONIC);
    }

    CanFrame& frame = out.frame;
    frame.error = (raw.can_id & CAN_ERR_FLAG) != 0;
    frame.extended = !frame.error && (raw.can_id & CAN_EFF_FLAG) != 0;
    frame.remote = !frame.error && (raw.can_id & CAN_RTR_FLAG) != 0;
    frame.id = raw.can_id & (frame.extended || frame.error ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame.fd = size == CANFD_MTU;
    frame.bit_rate_switch = frame.fd && (raw.flags & CANFD_BRS) != 0;
    frame.length = std::min(raw.len, static_cast<std::uint8_t>(frame.fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN));
    std::memcpy(frame.data.data(), raw.data, frame.length);
    if (frame.error) {
        ++statistics_.error_frames;
        note_error_class(frame.id);
    } else {
        ++statistics_.frames_received;
        bus_off_ = false;
        // What is received later than the interface was found down says that it is up again; who sends
        // nothing would not find out.
        if (down_ && out.timestamp_ns > down_since_ns_) down_ = false;
    }
    return CanStatus::ok;
}

void SocketCanBus::note_down(int error) {
    if (error == ENODEV || error == ENXIO) gone_.store(true, std::memory_order_relaxed);
    if (!down_) down_since_ns_ = read_clock_ns(CLOCK_MONOTONIC);
    down_ = true;
    unconfirmed_count_ = 0;
}

void SocketCanBus::note_error_class(std::uint32_t error_class) {
    if ((error_class & (CAN_ERR_BUSOFF | CAN_ERR_RESTARTED)) != 0) unconfirmed_count_ = 0;
    if ((error_class & CAN_ERR_BUSOFF) != 0) {
        bus_off_ = true;
        ++statistics_.bus_off;
    }
    if ((error_class & CAN_ERR_RESTARTED) != 0) {
        bus_off_ = false;
    }
}

// The stamp is CLOCK_REALTIME's. The offset between the two clocks is read after the frame and smoothed,
// since one reading is as good as the time between its two halves; it errs to one side only, so that a stamp
// never comes out before the frame. When somebody has set the clock between stamp and now, the age by the old
// offset and by the new one differ by the step: the true one is not negative, and is the smaller (a frame
// does not wait here for longer than a clock is set by).
//
// Frames that waited together share one reading, which must not be older than the frame.
std::int64_t SocketCanBus::to_monotonic_ns(std::int64_t stamp_realtime_ns) {
    constexpr std::int64_t step_ns = 1'000'000;
    std::int64_t change_ns = 0;
    if (!clocks_read_ || stamp_realtime_ns > realtime_ns_) {
        realtime_ns_ = read_clock_ns(CLOCK_REALTIME);
        monotonic_ns_ = read_clock_ns(CLOCK_MONOTONIC);
        clocks_read_ = true;
        change_ns = realtime_ns_ - monotonic_ns_ - realtime_offset_ns_;
    }
    const std::int64_t age_then_ns = monotonic_ns_ + realtime_offset_ns_ - stamp_realtime_ns;
    std::int64_t age_ns = age_then_ns;
    if (change_ns > -step_ns && change_ns < step_ns) {
        realtime_offset_ns_ += change_ns / 16;
    } else {
        realtime_offset_ns_ += change_ns;
        const std::int64_t age_now_ns = age_then_ns + change_ns;
        if (age_then_ns < 0 || (age_now_ns >= 0 && age_now_ns < age_then_ns)) {
            age_ns = age_now_ns;
        }
    }
    // Never in the future, never before an earlier frame.
    last_timestamp_ns_ = std::max(last_timestamp_ns_, monotonic_ns_ - std::max<std::int64_t>(age_ns, 0));
    return last_timestamp_ns_;
}

bool SocketCanBus::set_filters(std::span<const CanFilter> filters) {
    if (filters.size() > max_filters) {
        return false;
    }
    std::array<can_filter, max_filters> raw{};
    for (std::size_t i = 0; i < filters.size(); ++i) {
        const CanFilter& filter = filters[i];
        // The format's flag is part of the comparison, or the other format's frames would pass as well.
        raw[i].can_id = (filter.id & CAN_EFF_MASK) | (filter.extended ? CAN_EFF_FLAG : 0U);
        raw[i].can_mask = (filter.mask & CAN_EFF_MASK) | CAN_EFF_FLAG;
    }
    if (setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FILTER, raw.data(),
                   static_cast<socklen_t>(filters.size() * sizeof(can_filter))) != 0) {
        return false;
    }
    filters_ = raw;
    filter_count_ = filters.size();
    accept_all_ = false;
    unconfirmed_count_ = 0;
    return true;
}

}  // namespace wheelwright::hal
