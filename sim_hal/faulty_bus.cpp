#include "sim_hal/faulty_bus.hpp"

namespace wheelwright::sim {

hal::CanStatus FaultyBus::send(const hal::CanFrame& frame) {
    if (!send_rule_) return bus_.send(frame);
    hal::ReceivedFrame sent{frame, 0};
    switch (send_rule_(sent)) {
        case Deal::lose:
            return hal::CanStatus::ok;
        case Deal::refuse:
            ++refused_;
            return hal::CanStatus::would_block;
        case Deal::twice: {
            const hal::CanStatus status = bus_.send(sent.frame);
            if (status == hal::CanStatus::ok) bus_.send(sent.frame);
            return status;
        }
        case Deal::pass:
        case Deal::later:
            break;
    }
    return bus_.send(sent.frame);
}

hal::CanStatus FaultyBus::receive(hal::ReceivedFrame& out) {
    if (waiting_count_ > 0) {
        out = waiting_[0];
        waiting_[0] = waiting_[1];
        --waiting_count_;
        return hal::CanStatus::ok;
    }
    for (;;) {
        const hal::CanStatus status = bus_.receive(out);
        if (status != hal::CanStatus::ok) return status;
        Deal deal = receive_rule_ ? receive_rule_(out) : Deal::pass;
        if (deal == Deal::lose) continue;
        if (deal == Deal::later && !holds_) {
            held_ = out;
            holds_ = true;
            continue;
        }
        if (deal == Deal::twice) waiting_[waiting_count_++] = out;
        if (holds_) waiting_[waiting_count_++] = held_;
        holds_ = false;
        return hal::CanStatus::ok;
    }
}

hal::CanStatistics FaultyBus::statistics() const {
    hal::CanStatistics statistics = bus_.statistics();
    statistics.send_refused += refused_;
    return statistics;
}

}  // namespace wheelwright::sim
