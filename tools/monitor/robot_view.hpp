// What a listener knows of a robot: the latest telemetry, counted and aged, as a screen, a line or a report.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firmware/protocol/wheelwright_messages.hpp"
#include "hal/can_bus.hpp"
#include "tools/cli/ident_words.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/cli/report.hpp"

namespace wheelwright::tools {

class RobotView {
  public:
    // Takes one frame in; true when it was one of our messages and good.
    bool accept(const hal::CanFrame& frame, std::int64_t time_ns);

    // The state, the fault, the blocker or the identification's end differs from the last time this was
    // asked.
    bool status_changed();

    bool heard() const { return status_.has_value(); }

    // Several lines, for a terminal. `now_ns` is on the frames' time base.
    std::string screen(std::int64_t now_ns) const;

    // One line, without a newline: time since the first frame, state, pose, speeds.
    std::string line(std::int64_t time_ns) const;

    // Everything at the end of a log.
    void fill(Report& report) const;

  private:
    struct Effect {
        float value = 0;
        std::optional<float> standard_error;
    };
    struct Tally {
        std::uint64_t frames = 0;
        std::uint64_t bad = 0;
        std::string last_error;
    };

    template <typename Message>
    bool take(const hal::CanFrame& frame, std::optional<Message>& into);
    std::string limits_text() const;
    std::vector<std::string> ident_words() const;

    std::optional<protocol::Status> status_;
    std::array<std::optional<std::uint32_t>, protocol::counter_cause_values.size()> counters_;
    std::optional<protocol::WheelState> wheels_;
    std::optional<protocol::Odometry> odometry_;
    std::optional<protocol::BodyState> body_;
    std::optional<protocol::TrackingError> tracking_;
    std::optional<protocol::EstimateK5K7> k5_k7_;
    std::optional<protocol::EstimateK6K8> k6_k8_;
    std::optional<protocol::StandardErrorK5K7> error_k5_k7_;
    std::optional<protocol::StandardErrorK6K8> error_k6_k8_;
    std::map<std::uint16_t, Effect> effects_;
    std::optional<protocol::IdentStatus> ident_;
    std::optional<protocol::Timing> timing_;
    std::optional<protocol::BusLoad> bus_load_;
    std::optional<protocol::LoopDesign> design_;
    DriveErrors drive_errors_;
    std::array<std::optional<protocol::DriveHealth>, 2> health_;  // left, right
    std::optional<protocol::TrajectoryPace> pace_;
    IdentLayout layout_;
    std::map<std::uint32_t, Tally> tally_;  // our messages by identifier
    std::uint64_t others_ = 0;              // frames that are not ours (drives)
    std::uint64_t error_frames_ = 0;
    std::int64_t first_ns_ = 0;
    std::int64_t last_ns_ = 0;
    std::int64_t status_ns_ = 0;
    bool any_ = false;
    std::string told_;
};

}  // namespace wheelwright::tools
