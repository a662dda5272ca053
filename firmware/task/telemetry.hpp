// What the firmware tells the host: each telemetry message at its cycle time of the DBC, at most one frame in
// a cycle, so that the bus is never flooded and the torques' phase is never disturbed. Replies to parameter
// requests go first. A message that waits for longer than its own period is counted as deferred, and sent
// when its turn comes; nothing is dropped but a reply that finds the reply queue full, which is counted too.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/model/types.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "hal/can_bus.hpp"

namespace wheelwright::task {

// An effect parameter as the estimator sees it now.
struct EffectReport {
    std::uint16_t index = 0;  // model::effect_index
    double value = 0;
    double standard_error = 0;
};

// A snapshot of one cycle: all that telemetry speaks of. Its parts are filled in when they are wanted.
enum class ReportPart : std::uint8_t {
    status,
    motion,  // wheels, pose, twist, reference, tracking error
    estimate,
    effects,
    ident,
    ident_sizing,
    drives,
    drive_health,
    pace,
    timing,
    bus_load,
    design,
    counters,
};
inline constexpr std::size_t kReportParts = 13;

inline constexpr std::size_t kEffectParameters = [] {
    std::size_t total = 0;
    for (const model::EffectInfo& effect : model::kEffects) total += effect.parameters.size();
    return total;
}();

struct CycleReport {
    protocol::Status status;
    WheelPair<double> wheel_speed_rad_per_s;
    WheelPair<double> torque_Nm;  // commanded, after all limits
    Pose<double> pose;
    Twist<double> twist;
    Twist<double> reference;
    Pose<double> tracking_error;  // x: along, y: across, in the reference's frame
    model::Dynamics<double> estimate;
    model::Dynamics<double> standard_error;
    model::Dynamics<double> covariance;                   // bare diagonal of P
    std::array<EffectReport, kEffectParameters> effects;  // all may be active
    std::size_t effect_count = 0;
    protocol::IdentStatus ident;
    std::array<double, protocol::ident_quantity_values.size()> ident_quantities{};
    std::uint8_t drive_generation = 0;
    std::array<std::uint32_t, 2> drive_error_bits{};      // left, right
    std::array<protocol::DriveHealth, 2> drive_health{};  // left, right
    bool drive_health_told = false;                       // a drive reports some of it, or should
    protocol::TrajectoryPace pace;
    bool pace_known = false;
    protocol::Timing timing;
    protocol::BusLoad bus_load;
    protocol::LoopDesign design;
    std::array<std::uint32_t, protocol::counter_cause_values.size()> counters{};
};

class Telemetry {
  public:
    using Frame = hal::CanFrame;

    Telemetry();

    void reply(const protocol::ParameterReply& reply);
    // Goes first; in place of one that has not left yet.
    void ask(const protocol::ArmingChallenge& challenge) { challenge_ = challenge; }

    // What is to be sent in a cycle. The number of the cycle counts up by one in each call of next().
    struct Turn {
        bool due = false;
        bool reply = false;    // to a request, for which no part of the report is needed
        std::uint32_t id = 0;  // else of this message,
        ReportPart part{};     // which needs this part
    };
    Turn next(std::uint64_t cycle);

    // Fills `out` with the frame of that turn; false: there is nothing to tell.
    bool build(const Turn& turn, const CycleReport& report, Frame& out);

    std::uint32_t deferred() const { return deferred_; }
    std::uint32_t replies_lost() const { return replies_lost_; }

  private:
    struct Slot {
        std::uint32_t id;
        std::uint32_t period_cycles;
        std::uint64_t due;
        ReportPart part;
    };
    static constexpr std::size_t kSlots = 22;

    bool build_message(std::uint32_t id, const CycleReport& report, Frame& out);

    std::array<Slot, kSlots> slots_;
    std::uint64_t first_due_ = 0;  // of all slots
    std::array<protocol::ParameterReply, 16> replies_{};
    std::size_t reply_head_ = 0;
    std::size_t reply_count_ = 0;
    std::optional<protocol::ArmingChallenge> challenge_;
    std::uint32_t deferred_ = 0;
    std::uint32_t replies_lost_ = 0;
    std::size_t counter_turn_ = 0;
    std::size_t effect_turn_ = 0;
    std::size_t effect_error_turn_ = 0;
    std::size_t drive_turn_ = 0;
    std::size_t health_turn_ = 0;
    std::size_t quantity_turn_ = 0;
    std::uint8_t alive_ = 0;
};

}  // namespace wheelwright::task
