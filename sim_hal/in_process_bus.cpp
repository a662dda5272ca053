#include "sim_hal/in_process_bus.hpp"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>
#include <type_traits>

namespace wheelwright::sim {

namespace {

constexpr std::uint32_t standard_id_limit = 0x800;
constexpr std::uint64_t random_stream = 0xB05;  // the seed is shared with the rest of a simulation
constexpr int interframe_bits = 3;
// Error flag (6, at most 12 when they overlap), delimiter (8).
constexpr int error_frame_bits = 20;
constexpr std::uint32_t transmit_error_step = 8;
constexpr std::uint32_t bus_off_limit = 256;

// Copies what the frame uses; the bytes past its length stay as they are, or come along up to the eighth.
// Header and eight data bytes in one piece are two moves, where member by member would be twenty.
inline void copy_used(const hal::CanFrame& from, hal::CanFrame& to) {
    static_assert(std::is_trivially_copyable_v<hal::CanFrame>);
    constexpr std::size_t header = offsetof(hal::CanFrame, data);
    std::memcpy(static_cast<void*>(&to), static_cast<const void*>(&from), header + 8);
    if (from.length > 8) {
        std::memcpy(to.data.data() + 8, from.data.data() + 8, from.length - std::size_t{8});
    }
}

// The bits that decide arbitration, in their order on the wire: base identifier, RTR or SRR, IDE, the 18 bits
// of an extended identifier, its RTR. The lower number wins.
std::uint32_t arbitration_key(const hal::CanFrame& frame) {
    const std::uint32_t remote = frame.remote ? 1U : 0U;
    if (!frame.extended) {
        return frame.id << 21 | remote << 20;
    }
    return (frame.id >> 18) << 21 | 1U << 20 | 1U << 19 | (frame.id & 0x3FFFFU) << 1 | remote;
}

int stuff_bits(int bits, Stuffing stuffing) {
    // Worst case: five equal bits, then each stuff bit begins the next run, so one in four. Random: a run of
    // five takes 31 bits on average, the stuff bit being the first of the next.
    return stuffing == Stuffing::worst_case ? (bits - 1) / 4 : bits / 30;
}

// From the start bit to the last bit of the end-of-frame field.
int classic_bits(bool extended, int length, Stuffing stuffing) {
    const int stuffed = (extended ? 54 : 34) + 8 * length;  // start bit to CRC
    return stuffed + stuff_bits(stuffed, stuffing) + 10;    // CRC delimiter, acknowledge (2), end (7)
}

std::int64_t to_ns(int bits, std::uint32_t bit_rate) {
    return std::int64_t{bits} * 1'000'000'000 / std::int64_t{bit_rate};
}

std::size_t bounded(std::size_t value, std::size_t low, std::size_t high) {
    return std::clamp(value, low, high);
}

}  // namespace

// --- endpoint --------------------------------------------------------------------------------------------

hal::CanStatus InProcessBus::Endpoint::send(const hal::CanFrame& frame) {
    bus_->catch_up();
    hal::CanStatus status = hal::CanStatus::ok;
    if (down_ || bus_off_) {
        status = hal::CanStatus::bus_down;
    } else if (!hal::is_sendable(frame, bus_->fd_)) {
        status = hal::CanStatus::invalid;
    } else if (transmit_count_ >= transmit_limit_) {
        status = hal::CanStatus::would_block;
    }
    if (status != hal::CanStatus::ok) {
        ++statistics_.send_refused;
        return status;
    }
    copy_used(frame, transmit_[(transmit_first_ + transmit_count_) & bus_->transmit_mask_]);
    if (bus_->waiting_ == 0) {
        bus_->request_ns_ = bus_->now_ns_;
    }
    if (transmit_count_ == 0) {
        bus_->waiting_ |= bit_;
        bus_->planned_ = false;
        bus_->head_key_[static_cast<std::size_t>(std::countr_zero(bit_))] = arbitration_key(frame);
    }
    ++transmit_count_;
    ++statistics_.frames_sent;
    return hal::CanStatus::ok;
}

bool InProcessBus::Endpoint::waits(std::uint32_t id) const {
    for (std::size_t i = 0; i < transmit_count_; ++i) {
        if (transmit_[(transmit_first_ + i) & bus_->transmit_mask_].id == id) return true;
    }
    return false;
}

hal::CanStatus InProcessBus::Endpoint::receive(hal::ReceivedFrame& out) {
    bus_->catch_up();
    if (receive_count_ == 0 || receive_[receive_first_].available_ns > bus_->now_ns_) {
        return down_ || bus_off_ ? hal::CanStatus::bus_down : hal::CanStatus::would_block;
    }
    const hal::ReceivedFrame& oldest = receive_[receive_first_].received;
    copy_used(oldest.frame, out.frame);
    out.timestamp_ns = oldest.timestamp_ns;
    receive_first_ = (receive_first_ + 1) & bus_->receive_mask_;
    --receive_count_;
    if (out.frame.error) {
        ++statistics_.error_frames;
    } else {
        ++statistics_.frames_received;
    }
    return hal::CanStatus::ok;
}

bool InProcessBus::Endpoint::set_filters(std::span<const hal::CanFilter> filters) {
    if (filters.size() > max_filters) {
        return false;
    }
    bus_->catch_up();  // frames that ended before were judged by the old set
    accept_all_ = false;
    bus_->deaf_ = filters.empty() ? bus_->deaf_ | bit_ : bus_->deaf_ & ~bit_;
    accepted_standard_.fill(0);
    extended_filter_count_ = 0;
    for (const hal::CanFilter& filter : filters) {
        if (filter.extended) {
            extended_filters_[extended_filter_count_++] = filter;
            continue;
        }
        for (std::uint32_t id = 0; id < standard_id_limit; ++id) {
            if ((id & filter.mask) == (filter.id & filter.mask)) {
                accepted_standard_[id / 64] |= std::uint64_t{1} << (id % 64);
            }
        }
    }
    return true;
}

hal::CanStatistics InProcessBus::Endpoint::statistics() const {
    bus_->catch_up();
    return statistics_;
}

std::int64_t InProcessBus::Endpoint::next_receive_ns() const {
    bus_->catch_up();
    return receive_count_ == 0 ? never_ns : receive_[receive_first_].available_ns;
}

bool InProcessBus::Endpoint::accepts(const hal::CanFrame& frame) const {
    if (frame.error) {
        return true;
    }
    if (!frame.extended) {
        return (accepted_standard_[frame.id / 64] >> (frame.id % 64) & 1U) != 0;
    }
    for (std::size_t i = 0; i < extended_filter_count_; ++i) {
        const hal::CanFilter& filter = extended_filters_[i];
        if ((frame.id & filter.mask) == (filter.id & filter.mask)) {
            return true;
        }
    }
    return false;
}

void InProcessBus::Endpoint::offer(const hal::CanFrame& frame, std::int64_t timestamp_ns) {
    if (!accept_all_ && !accepts(frame)) {
        return;
    }
    if (receive_count_ == bus_->receive_capacity_) {
        ++statistics_.receive_overflow;
        return;
    }
    Waiting& slot = receive_[(receive_first_ + receive_count_) & bus_->receive_mask_];
    ++receive_count_;
    copy_used(frame, slot.received.frame);
    slot.received.timestamp_ns = timestamp_ns;
    std::int64_t available_ns = timestamp_ns + latency_ns_;
    if (jitter_ns_ > 0) {
        // Uniform in 0 .. jitter; the bias, jitter / 2^32, does not matter.
        available_ns += static_cast<std::int64_t>(
            (bus_->random_.bits() >> 32) * static_cast<std::uint64_t>(jitter_ns_ + 1) >> 32);
    }
    // A frame that is ready before the one in front of it waits for that: the queue keeps their order.
    slot.available_ns = available_ns;
}

void InProcessBus::Endpoint::drop_transmit_queue() {
    transmit_count_ = 0;
    bus_->waiting_ &= ~bit_;
    bus_->planned_ = false;
    if (bus_->on_wire_ && &bus_->endpoints_[bus_->sender_] == this) {
        // The frame breaks off. The others say so with an error flag, which takes its time on the wire.
        bus_->on_wire_ = false;
        bus_->free_ns_ = bus_->now_ns_ + bus_->error_frame_ns_ + bus_->interframe_ns_;
    }
}

// --- bus -------------------------------------------------------------------------------------------------

InProcessBus::InProcessBus(const hal::Clock& clock, std::size_t endpoint_count,
                           const InProcessBusOptions& options)
    : clock_(&clock),
      now_ns_(clock.now_ns()),
      free_ns_(now_ns_),
      endpoint_count_(bounded(endpoint_count, 1, max_endpoints)),
      transmit_capacity_(bounded(options.transmit_capacity, 1, 4096)),
      receive_capacity_(bounded(options.receive_capacity, 1, 65536)),
      transmit_mask_(std::bit_ceil(transmit_capacity_) - 1),
      receive_mask_(std::bit_ceil(receive_capacity_) - 1),
      fd_(options.fd),
      stuffing_(options.stuffing),
      bit_rate_(std::max(options.bit_rate, 10'000U)),
      data_bit_rate_(std::max(options.data_bit_rate, 10'000U)),
      interframe_ns_(to_ns(interframe_bits, bit_rate_)),
      error_frame_ns_(to_ns(error_frame_bits, bit_rate_)),
      random_(options.seed, random_stream) {
    for (int length = 0; length <= 8; ++length) {
        for (const bool extended : {false, true}) {
            classic_ns_[extended ? 1 : 0][static_cast<std::size_t>(length)] =
                to_ns(classic_bits(extended, length, stuffing_), bit_rate_);
        }
    }
    for (std::size_t i = 0; i < endpoint_count_; ++i) {
        Endpoint& endpoint = endpoints_[i];
        endpoint.bus_ = this;
        endpoint.bit_ = 1U << i;
        endpoint.latency_ns_ = std::max<std::int64_t>(options.receive_latency_ns, 0);
        endpoint.jitter_ns_ = std::clamp<std::int64_t>(options.receive_jitter_ns, 0, max_jitter_ns);
        endpoint.transmit_.resize(transmit_mask_ + 1);
        endpoint.transmit_limit_ = transmit_capacity_;
        endpoint.receive_.resize(receive_mask_ + 1);
        active_ |= endpoint.bit_;
    }
}

// Who gets the wire at an instant is decided only once time has gone past it: until then others may join.
void InProcessBus::run_to(std::int64_t now_ns) {
    now_ns_ = now_ns;
    while (true) {
        if (!on_wire_) {
            if (waiting_ == 0 || std::max(free_ns_, request_ns_) >= now_ns) {
                break;
            }
            begin();
        }
        if (end_ns_ > now_ns) {
            break;
        }
        finish();
    }
}

std::size_t InProcessBus::winner() const {
    std::size_t best = static_cast<std::size_t>(std::countr_zero(waiting_));
    for (std::uint32_t rest = waiting_ & (waiting_ - 1); rest != 0; rest &= rest - 1) {
        const std::size_t index = static_cast<std::size_t>(std::countr_zero(rest));
        if (head_key_[index] < head_key_[best]) {
            best = index;
        }
    }
    return best;
}

// Who would send next, from when to when, as the queues stand now. Whatever changes them takes `planned_`
// back.
void InProcessBus::plan() {
    sender_ = winner();
    const Endpoint& from = endpoints_[sender_];
    start_ns_ = std::max(free_ns_, request_ns_);
    end_ns_ = start_ns_ + wire_time_ns(from.transmit_[from.transmit_first_]);
    planned_ = true;
}

void InProcessBus::begin() {
    if (!planned_) {
        plan();
    }
    planned_ = false;
    fate_ = Fate::pass;
    if (fault_count_ != 0) {
        const Endpoint& from = endpoints_[sender_];
        fate_ = decide_fate(from.transmit_[from.transmit_first_]);
        if (fate_ == Fate::destroy) {
            end_ns_ += error_frame_ns_;
        }
    }
    free_ns_ = end_ns_ + interframe_ns_;
    on_wire_ = true;
}

void InProcessBus::finish() {
    on_wire_ = false;
    totals_.busy_ns += free_ns_ - start_ns_;
    Endpoint& from = endpoints_[sender_];
    hal::CanFrame& frame = from.transmit_[from.transmit_first_];
    std::uint32_t receivers = active_ & ~from.bit_ & ~deaf_;
    if (fate_ != Fate::pass) {
        if (fate_ == Fate::destroy) {
            destroy(from);
            return;  // the frame stays first in its queue
        }
        if (fate_ == Fate::drop) {
            receivers = 0;
            ++totals_.dropped;
        } else {
            corrupt(frame);
        }
    }
    ++totals_.frames;
    if (tap_count_ != 0) {
        tell_taps(WireEvent{&frame, start_ns_, end_ns_, sender_, fate_ == Fate::drop});
    }
    for (; receivers != 0; receivers &= receivers - 1) {
        endpoints_[static_cast<std::size_t>(std::countr_zero(receivers))].offer(frame, end_ns_);
    }
    if (from.transmit_errors_ > 0) {
        --from.transmit_errors_;
    }
    from.transmit_first_ = (from.transmit_first_ + 1) & transmit_mask_;
    if (--from.transmit_count_ == 0) {
        waiting_ &= ~from.bit_;
    } else {
        head_key_[sender_] = arbitration_key(from.transmit_[from.transmit_first_]);
    }
}

void InProcessBus::destroy(Endpoint& from) {
    ++totals_.destroyed;
    deliver_error(active_, error_protocol | error_bus, end_ns_);
    from.transmit_errors_ += transmit_error_step;
    if (from.transmit_errors_ >= bus_off_limit) {
        leave_bus(from, end_ns_);
    }
}

void InProcessBus::corrupt(hal::CanFrame& frame) {
    ++totals_.corrupted;
    const auto bit = static_cast<std::size_t>(random_.bits() % (std::uint64_t{frame.length} * 8));
    frame.data[bit / 8] = static_cast<std::uint8_t>(frame.data[bit / 8] ^ (1U << (bit % 8)));
}

void InProcessBus::tell_taps(const WireEvent& event) {
    for (std::size_t i = 0; i < tap_count_; ++i) {
        taps_[i]->on_frame(event);
    }
}

std::int64_t InProcessBus::next_event_ns() {
    catch_up();
    if (!on_wire_ && !planned_) {
        if (waiting_ == 0) {
            return never_ns;
        }
        plan();
    }
    return end_ns_;
}

std::int64_t InProcessBus::next_arrival_ns(const Endpoint& endpoint) {
    std::int64_t arrival_ns = next_event_ns();
    if (arrival_ns != never_ns && &endpoints_[sender_] == &endpoint) {
        // After its own frame the wire goes to another one of those that wait, at the earliest.
        const bool alone = waiting_ == endpoint.bit_ && endpoint.transmit_count_ == 1;
        const std::int64_t shortest_ns = fd_ ? 0 : classic_ns_[0][0];
        const bool may_fail = fault_count_ != 0 || fate_ == Fate::destroy;  // and come back as an error
        arrival_ns = may_fail ? end_ns_ : alone ? never_ns : end_ns_ + interframe_ns_ + shortest_ns;
    }
    // A frame that waits although its time has come is one that a failed endpoint holds back.
    if (endpoint.receive_count_ != 0) {
        const std::int64_t waiting_ns = endpoint.receive_[endpoint.receive_first_].available_ns;
        if (waiting_ns > now_ns_) arrival_ns = std::min(arrival_ns, waiting_ns);
    }
    return arrival_ns;
}

std::int64_t InProcessBus::wire_time_ns(const hal::CanFrame& frame) const {
    if (!frame.fd) {
        return classic_ns_[frame.extended ? 1 : 0][frame.remote ? 0 : frame.length];
    }
    // ISO 11898-1: start bit to bit-rate switch, then ESI, DLC and data with ordinary stuffing, then the
    // stuff count and the CRC with a fixed stuff bit before each four, then delimiter, acknowledge (2) and
    // end (7).
    const int header = frame.extended ? 36 : 17;
    const int payload = 5 + 8 * frame.length;
    const int checksum = frame.length <= 16 ? 4 + 17 + 6 : 4 + 21 + 7;
    const int header_stuffed = header + stuff_bits(header, stuffing_);
    const int all_stuffed = header + payload + stuff_bits(header + payload, stuffing_);
    return to_ns(header_stuffed + 10, bit_rate_) +
           to_ns(all_stuffed - header_stuffed + checksum, frame.bit_rate_switch ? data_bit_rate_ : bit_rate_);
}

bool InProcessBus::add_tap(BusTap& tap) {
    if (tap_count_ == max_taps) {
        return false;
    }
    taps_[tap_count_++] = &tap;
    return true;
}

bool InProcessBus::add_fault(const FaultRule& rule) {
    if (fault_count_ == max_faults) {
        return false;
    }
    catch_up();
    faults_[fault_count_++] = Fault{rule, 0};
    return true;
}

void InProcessBus::clear_faults() {
    catch_up();
    fault_count_ = 0;
}

InProcessBus::Fate InProcessBus::decide_fate(const hal::CanFrame& frame) {
    Fate fate = Fate::pass;
    for (std::size_t i = 0; i < fault_count_; ++i) {
        Fault& fault = faults_[i];
        const FaultRule& rule = fault.rule;
        if ((frame.id & rule.mask) != (rule.id & rule.mask) ||
            (rule.action == FaultAction::corrupt && (frame.length == 0 || frame.remote))) {
            continue;
        }
        // Each rule counts every frame it matches, hit by another or not, so that rules do not disturb each
        // other's counts.
        const std::uint64_t seen = fault.seen;
        if (seen < std::numeric_limits<std::uint32_t>::max()) {
            ++fault.seen;
        }
        const bool candidate = seen >= rule.skip && seen - rule.skip < rule.count;
        if (fate != Fate::pass || !candidate) {
            continue;
        }
        if (rule.probability < 1 && random_.uniform() >= rule.probability) {
            continue;
        }
        switch (rule.action) {
            case FaultAction::drop:
                fate = Fate::drop;
                break;
            case FaultAction::corrupt:
                fate = Fate::corrupt;
                break;
            case FaultAction::destroy:
                fate = Fate::destroy;
                break;
        }
    }
    return fate;
}

void InProcessBus::set_down(std::size_t index, bool down) {
    catch_up();
    Endpoint& endpoint = endpoints_[index];
    endpoint.down_ = down;
    if (down) {
        endpoint.drop_transmit_queue();
        active_ &= ~endpoint.bit_;
    } else if (!endpoint.bus_off_) {
        active_ |= endpoint.bit_;
    }
}

void InProcessBus::leave_bus(Endpoint& endpoint, std::int64_t time_ns) {
    if (endpoint.bus_off_) {
        return;
    }
    endpoint.bus_off_ = true;
    ++endpoint.statistics_.bus_off;
    endpoint.drop_transmit_queue();
    active_ &= ~endpoint.bit_;
    deliver_error(endpoint.bit_, error_bus_off, time_ns);
}

void InProcessBus::set_bus_off(std::size_t index) {
    catch_up();
    leave_bus(endpoints_[index], now_ns_);
}

void InProcessBus::recover(std::size_t index) {
    catch_up();
    Endpoint& endpoint = endpoints_[index];
    if (!endpoint.bus_off_) {
        return;
    }
    endpoint.bus_off_ = false;
    endpoint.transmit_errors_ = 0;
    if (!endpoint.down_) {
        active_ |= endpoint.bit_;
    }
    deliver_error(endpoint.bit_, error_restarted, now_ns_);
}

void InProcessBus::inject_error_frame(std::uint32_t error_class) {
    catch_up();
    deliver_error(active_, error_class, now_ns_);
}

void InProcessBus::limit_transmit_queue(std::size_t index, std::size_t frames) {
    endpoints_[index].transmit_limit_ = bounded(frames, 1, transmit_capacity_);
}

void InProcessBus::set_receive_latency(std::size_t index, std::int64_t latency_ns, std::int64_t jitter_ns) {
    catch_up();
    endpoints_[index].latency_ns_ = std::max<std::int64_t>(latency_ns, 0);
    endpoints_[index].jitter_ns_ = std::clamp<std::int64_t>(jitter_ns, 0, max_jitter_ns);
}

void InProcessBus::deliver_error(std::uint32_t receivers, std::uint32_t error_class, std::int64_t time_ns) {
    hal::CanFrame frame;
    frame.id = error_class;
    frame.length = 8;
    frame.error = true;
    frame.data.fill(0);
    tell_taps(WireEvent{&frame, time_ns, time_ns, sender_, false});
    for (; receivers != 0; receivers &= receivers - 1) {
        endpoints_[static_cast<std::size_t>(std::countr_zero(receivers))].offer(frame, time_ns);
    }
}

}  // namespace wheelwright::sim
