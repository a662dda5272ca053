// A CAN bus that lies: stands between one node and its endpoint, and loses, repeats, reorders, changes or
// refuses frames as it is told. InProcessBus has the faults of the wire, which all nodes share; these are the
// faults of one node's controller and kernel, and of a sender that says what is not true.
//
// Without a rule it hands everything on unchanged. Threads: one. A call allocates only if the rule does.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>

#include "hal/can_bus.hpp"

namespace wheelwright::sim {

class FaultyBus final : public hal::CanBus {
  public:
    enum class Deal : std::uint8_t {
        pass,
        lose,    // nobody is told
        twice,   // arrives a second time, directly behind
        later,   // behind the next frame that passes; received frames only, sent ones pass
        refuse,  // send() says that the queue is full; received frames only pass
    };
    // May change the frame and, where it is received, its timestamp, before it decides.
    using Rule = std::function<Deal(hal::ReceivedFrame&)>;

    explicit FaultyBus(hal::CanBus& bus) : bus_(bus) {}

    // Null: no faults. A frame that waits for the next one still comes behind that.
    void on_receive(Rule rule) { receive_rule_ = std::move(rule); }
    // The timestamp of a sent frame has no meaning.
    void on_send(Rule rule) { send_rule_ = std::move(rule); }

    hal::CanStatus send(const hal::CanFrame& frame) override;
    bool waits(std::uint32_t id) const override { return bus_.waits(id); }
    hal::CanStatus receive(hal::ReceivedFrame& out) override;
    bool set_filters(std::span<const hal::CanFilter> filters) override { return bus_.set_filters(filters); }
    // The endpoint's own: frames lost or repeated here are not in it, refused ones are.
    hal::CanStatistics statistics() const override;

  private:
    hal::CanBus& bus_;
    Rule receive_rule_;
    Rule send_rule_;
    std::uint64_t refused_ = 0;
    // To be received before the endpoint is asked: what comes twice or later.
    std::array<hal::ReceivedFrame, 2> waiting_{};
    std::size_t waiting_count_ = 0;
    hal::ReceivedFrame held_;
    bool holds_ = false;
};

}  // namespace wheelwright::sim
