// A CAN bus through Linux's SocketCAN: one raw socket on one interface.
//
// Timestamps are the kernel's software receive stamps (taken in the driver's interrupt path), converted to
// CLOCK_MONOTONIC, so they compare with MonotonicClock. Frames that other programs on this machine send are
// received; our own are not.
//
// What it cannot see: a queueing discipline that drops frames in silence. Kernels before 5.15 may give a CAN
// interface fq_codel, which does: `tc qdisc replace dev can0 root pfifo_fast`. An interface's own transmit
// queue holds 10 frames unless `ip link set can0 txqueuelen N` says otherwise; when it is full, send() says
// would_block.
//
// What has left is known from the kernel's confirmations (CAN_RAW_RECV_OWN_MSGS): of controllers whose driver
// echoes at the end of the transmission, when a frame has been on the wire; of others (vcan), when the
// interface has taken it. Confirmations pass the filters like other frames, so waits() knows of identifiers
// that the filters accept. One that is lost is made up by the next one.
//
// bus_down is noticed in send() and receive(), and taken back when a frame gets through again, or when the
// controller reports a restart. A controller that is bus-off stays so unless `restart-ms` is set.
#pragma once

#include <linux/can.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "hal/can_bus.hpp"
#include "hal/linux/result.hpp"

namespace wheelwright::hal {

struct SocketCanOptions {
    // Bytes of kernel memory for frames that wait; a frame takes about 700 to 900. More than the system's
    // net.core.rmem_max needs CAP_NET_ADMIN; without it we get less, without a word.
    int receive_buffer_bytes = 1 << 20;
    // The same for frames that wait to be sent. The least that the kernel allows: some six or seven frames.
    // What waits on a jammed bus is old when it leaves.
    int send_buffer_bytes = 1;
};

class SocketCanBus final : public CanBus {
  public:
    static constexpr std::size_t max_filters = 64;

    // The interface must exist, be a CAN interface, and be up. FD frames are on when it carries them.
    // Errors: no CAN in the kernel, no such interface, not CAN, down, no permission (all of them kind
    // machine, except a name that no interface can have, and one that is not CAN: usage).
    static Result<std::unique_ptr<SocketCanBus>> open(const std::string& interface,
                                                      const SocketCanOptions& options = {});

    ~SocketCanBus() override;
    SocketCanBus(const SocketCanBus&) = delete;
    SocketCanBus& operator=(const SocketCanBus&) = delete;

    CanStatus send(const CanFrame& frame) override;
    bool waits(std::uint32_t id) const override;
    CanStatus receive(ReceivedFrame& out) override;
    bool set_filters(std::span<const CanFilter> filters) override;
    CanStatistics statistics() const override { return statistics_; }

    // The interface has been removed (its adapter pulled, say). One of that name that comes later is another
    // one: this bus stays down, and has to be opened anew. Any thread.
    bool gone() const { return gone_.load(std::memory_order_relaxed); }

    // Whether FD frames can be sent.
    bool carries_fd() const { return fd_frames_; }

    // For poll() and the like, once receive() has said that no frame waits; the bus keeps owning it.
    int descriptor() const { return socket_; }

  private:
    explicit SocketCanBus(int socket);

    static constexpr std::size_t batch = 16;
    struct Incoming {
        canfd_frame raw;
        alignas(cmsghdr)
            std::array<char, CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))> control;
    };

    bool take_waiting();
    void note_sent(std::uint32_t raw_id);
    void note_confirmed(std::uint32_t raw_id);
    std::int64_t to_monotonic_ns(std::int64_t stamp_realtime_ns);
    void note_down(int error);
    void note_error_class(std::uint32_t error_class);

    int socket_;
    bool fd_frames_ = false;
    bool confirms_ = false;
    std::array<can_filter, max_filters> filters_{};
    std::size_t filter_count_ = 0;
    bool accept_all_ = true;
    std::array<std::uint32_t, 32> unconfirmed_{};  // a ring of identifiers, with the kernel's flags
    std::size_t unconfirmed_first_ = 0;
    std::size_t unconfirmed_count_ = 0;
    std::int64_t down_since_ns_ = 0;
    bool down_ = false;
    bool bus_off_ = false;
    std::atomic<bool> gone_{false};
    std::uint32_t last_overflow_ = 0;      // the kernel's counter, 32 bits wide
    std::int64_t realtime_offset_ns_ = 0;  // CLOCK_REALTIME - CLOCK_MONOTONIC
    std::int64_t last_timestamp_ns_ = 0;
    bool emptied_ = false;  // the kernel's queue, by the last batch
    std::array<Incoming, batch> incoming_;
    std::array<iovec, batch> pieces_;
    std::array<mmsghdr, batch> messages_;
    std::size_t next_ = 0;      // of those taken from the kernel
    std::size_t waiting_ = 0;   // so many were taken
    bool clocks_read_ = false;  // both clocks, since the queue was last seen empty
    std::int64_t realtime_ns_ = 0;
    std::int64_t monotonic_ns_ = 0;
    CanStatistics statistics_;
};

}  // namespace wheelwright::hal
