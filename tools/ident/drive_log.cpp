#include "tools/ident/drive_log.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <optional>

#include "drivers/drive_catalogue.hpp"
#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "drivers/odrive/odrive_drive.hpp"
#include "firmware/control/encoder_loop.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/protocol/bus_load.hpp"
#include "firmware/protocol/codec.hpp"
#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/senses.hpp"

namespace wheelwright::tools {
namespace {

namespace gen5 = drivers::odrive_0_5;
namespace gen6 = drivers::odrive_0_6;
using drivers::Wheel;

constexpr std::size_t kMostNotes = 20;
constexpr std::int64_t kLongestHold_cycles = 20;  // a drive holds its torque over missing commands so long
constexpr double kEncoderGap_s = 0.005;
constexpr double kEncoderGapPeriods = 2.5;      // or two reports that were lost
constexpr std::int64_t kMemory_ns = 8'000'000;  // a reported torque was commanded within this time
constexpr double kPeriodTolerance = 0.2;
// A report may miss the commands' range by this share of the largest command.
constexpr double kFollowTolerance = 0.15;

struct Command {
    std::int64_t time_ns = 0;
    double torque_Nm = 0;
};

// One wheel's drive as the log shows it.
class DriveView {
  public:
    DriveView(const model::RobotParameters& robot, Wheel wheel, double encoder_lag_s)
        : encoder_period_s_(1e-3 * robot.drive.encoder_period_ms),
          config_(drivers::odrive_config(robot, wheel)),
          drive_(drivers::make_drive(slot_, robot, wheel)),
          wheel_per_motor_torque_(config_.sign * config_.gear_ratio * config_.torque_scale) {
        behind_loop_.configure(encoder_lag_s, drivers::kOdriveLoopPeriod_s, encoder_period_s_);
    }

    bool owns(const hal::CanFrame& frame) const {
        return !frame.extended && !frame.error && !frame.fd && !frame.remote &&
               frame.id >> 5U == config_.node;
    }
    static bool is_command(const hal::CanFrame& frame) {
        return (frame.id & 0x1FU) == gen6::SetInputTorque::command;
    }

    // "" or what is wrong with the frame.
    std::string take(const hal::CanFrame& frame, std::int64_t time_ns) {
        const std::span<const std::uint8_t> bytes{frame.data.data(), frame.length};
        reported_ = false;
        if (is_command(frame)) {
            gen6::SetInputTorque torque;
            if (gen6::SetInputTorque::decode(bytes, torque) != protocol::CodecStatus::ok) {
                return "torque command that cannot be decoded";
            }
            command_ = {time_ns, double{torque.input_torque_Nm} * wheel_per_motor_torque_};
            recent_[newest_++ % recent_.size()] = *command_;
            return "";
        }
        const drivers::DriveCounters before = drive_->counters();
        const std::int64_t torque_before_ns = drive_->feedback().torque_time_ns;
        drive_->was_sent(frame);
        drive_->accept({frame, time_ns});
        if (drive_->counters().not_finite != before.not_finite) return "a number that is not finite";
        if (drive_->counters().wrong_length != before.wrong_length) return "frame of the wrong length";
        if ((frame.id & 0x1FU) == gen6::Heartbeat::command) take_state(bytes);
        reported_ = drive_->feedback().torque_time_ns != torque_before_ns;
        const control::EncoderSample reported = task::encoder_sample(drive_->feedback());
        encoder_lag_.take(reported, encoder_period_s_);
        encoder_ = behind_loop_.sample(reported);
        return "";
    }

    const std::optional<Command>& command() const { return command_; }
    const drivers::DriveFeedback& feedback() const { return drive_->feedback(); }
    const control::EncoderSample& encoder() const { return encoder_; }
    bool closed_loop() const { return closed_loop_; }
    double encoder_lag_s() const {
        return encoder_lag_.lag_s(drivers::kOdriveLoopPeriod_s, encoder_period_s_);
    }

    // True when the last frame was a torque report that none of the recent commands explains.
    bool not_followed(std::int64_t now_ns, double largest_Nm) const {
        double low = 0;
        double high = 0;
        bool any = false;
        for (const Command& c : recent_) {
            if (c.time_ns == 0 || now_ns - c.time_ns > kMemory_ns) continue;
            low = any ? std::min(low, c.torque_Nm) : c.torque_Nm;
            high = any ? std::max(high, c.torque_Nm) : c.torque_Nm;
            any = true;
        }
        const double tolerance = kFollowTolerance * largest_Nm;
        const double torque = drive_->feedback().torque_Nm;
        return any && (torque < low - tolerance || torque > high + tolerance);
    }
    bool reported() const { return reported_; }

  private:
    void take_state(std::span<const std::uint8_t> bytes) {
        if (config_.generation == drivers::OdriveGeneration::v0_5) {
            gen5::Heartbeat heartbeat;
            if (gen5::Heartbeat::decode(bytes, heartbeat) == protocol::CodecStatus::ok) {
                closed_loop_ =
                    heartbeat.axis_error == 0 && heartbeat.axis_state == gen5::AxisState::closed_loop_control;
            }
        } else {
            gen6::Heartbeat heartbeat;
            if (gen6::Heartbeat::decode(bytes, heartbeat) == protocol::CodecStatus::ok) {
                closed_loop_ =
                    heartbeat.axis_error == 0 && heartbeat.axis_state == gen6::AxisState::closed_loop_control;
            }
        }
    }

    double encoder_period_s_;
    control::EncoderLoopLag encoder_lag_;
    control::EncoderBehindLoop behind_loop_;
    control::EncoderSample encoder_;
    drivers::OdriveConfig config_;
    drivers::DriveSlot slot_;
    drivers::MotorDrive* drive_;
    double wheel_per_motor_torque_;
    std::optional<Command> command_;
    std::array<Command, 16> recent_{};
    std::size_t newest_ = 0;
    bool closed_loop_ = false;
    bool reported_ = false;
};

class Reader {
  public:
    Reader(const model::RobotParameters& robot, const WheelPair<double>& encoder_lag_s)
        : left_(robot, Wheel::left, encoder_lag_s.left),
          right_(robot, Wheel::right, encoder_lag_s.right),
          radius_(robot.geometry.wheel_radius_m),
          track_m_(robot.geometry.track_m),
          before_command_ns_(static_cast<std::int64_t>(robot.realtime.send_phase_s * 1e9 +
                                                       1e9 * protocol::worst_case_bits(8, false) /
                                                           robot.bus.bit_rate_bit_per_s)),
          age_ns_(static_cast<std::int64_t>(task::Senses::sample_age_s(robot) * 1e9)),
          gap_ns_(static_cast<std::int64_t>(
              1e9 * std::max(kEncoderGap_s, kEncoderGapPeriods * 1e-3 * robot.drive.encoder_period_ms))) {
        plant_ = control::plant_model<double>(robot);
        observer_.configure(control::wheel_observer_settings<double>(robot, task::kCyclePeriod_s));
    }

    DriveLog read(std::istream& in) {
        CandumpReader reader(in);
        LogFrame entry;
        for (bool more = true; more;) {
            switch (reader.next(entry)) {
                case CandumpReader::Next::end:
                    more = false;
                    break;
                case CandumpReader::Next::bad_line:
                    if (log_.problems.size() < kMostNotes) log_.problems.push_back(reader.problem());
                    break;
                case CandumpReader::Next::frame:
                    take(entry, reader.line());
                    break;
            }
        }
        finish();
        return std::move(log_);
    }

  private:
    void note(std::string text) {
        if (log_.notes.size() < kMostNotes) log_.notes.push_back({line_, std::move(text)});
    }

    void take(const LogFrame& entry, std::size_t line) {
        line_ = line;
        if (log_.frames++ == 0) log_.first_time_ns = entry.time_ns;
        log_.last_time_ns = entry.time_ns;
        const bool left = left_.owns(entry.frame);
        if (!left && !right_.owns(entry.frame)) return;
        // Several interfaces may stand in one log; the drives are where their torque commands are.
        if (interface_.empty() && DriveView::is_command(entry.frame)) interface_ = entry.interface;
        if (!interface_.empty() && entry.interface != interface_) return;
        const bool begins = left && DriveView::is_command(entry.frame);
        const auto torque_of = [](const DriveView& drive) {
            return drive.command() ? drive.command()->torque_Nm : 0.0;
        };
        const WheelPair<double> told_before{torque_of(left_), torque_of(right_)};
        DriveView& drive = left ? left_ : right_;
        if (const std::string failed = drive.take(entry.frame, entry.time_ns); !failed.empty()) {
            note(failed);
            return;
        }
        if (begins) begin_cycle(entry.time_ns, told_before);
        if (DriveView::is_command(entry.frame)) {
            const double torque = drive.command()->torque_Nm;
            log_.largest_torque_Nm = std::max(log_.largest_torque_Nm, std::abs(torque));
        }
        if (drive.reported() && drive.closed_loop() && drive.command()) {
            ++log_.reports;
            if (drive.not_followed(entry.time_ns, log_.largest_torque_Nm)) {
                ++log_.not_followed;
                if (followed_) {
                    note("the drive of node " + std::to_string(entry.frame.id >> 5U) +
                         " does not deliver the commanded torque (saturated?): left out");
                }
                followed_ = false;
            } else {
                followed_ = true;
            }
        }
    }

    // A left command has come: it belongs to a new cycle. What was told in the cycle before is known now.
    void begin_cycle(std::int64_t time_ns, const WheelPair<double>& told_before) {
        const std::int64_t at_ns = time_ns - before_command_ns_;
        const bool first = start_ns_ == 0;
        const std::int64_t passed =
            first ? 0
                  : std::max<std::int64_t>(
                        1, (at_ns - start_ns_ + task::kCyclePeriod_ns / 2) / task::kCyclePeriod_ns);
        const bool gap = first || passed > kLongestHold_cycles;
        if (gap) {
            if (!first && left_.closed_loop() && right_.closed_loop()) {
                note("gap: no torque commands for " +
                     std::to_string((time_ns - last_command_ns_) / 1'000'000) + " ms: left out");
            }
            start_ns_ = at_ns;
        } else {
            start_ns_ += passed * task::kCyclePeriod_ns;
            const std::int64_t off_ns = at_ns - start_ns_;
            start_ns_ += off_ns / (off_ns < 0 ? 5 : 200);  // frames only ever come late
            ++commands_;
            command_time_ns_ += time_ns - last_command_ns_;
        }
        last_command_ns_ = time_ns;
        const std::int64_t right_age_ns = right_.command() ? time_ns - right_.command()->time_ns : INT64_MAX;
        if (right_age_ns > kLongestHold_cycles * task::kCyclePeriod_ns) {
            pending_restart_ = true;
            return;
        }
        if (!log_.cycles.empty()) {
            log_.torque_changes.left = log_.torque_changes.left || told_before.left != last_torque_.left;
            log_.torque_changes.right = log_.torque_changes.right || told_before.right != last_torque_.right;
        }
        last_torque_ = told_before;
        // cycles without commands, then this one: the drives held what they were told before
        const std::int64_t count = gap ? 1 : passed;
        for (std::int64_t i = count - 1; i >= 0; --i) {
            push(start_ns_ - i * task::kCyclePeriod_ns, count == 1, gap);
        }
    }

    void push(std::int64_t start_ns, bool commanded, bool restart) {
        observer_.update(start_ns, left_.encoder(), right_.encoder(), plant_);
        DriveLog::Cycle cycle;
        cycle.start_ns = start_ns;
        // as in the cycle, the last angles stay where none are known
        cycle.sample.usable = observer_.angles_at(start_ns - age_ns_, angle_rad_) && commanded && followed_ &&
                              left_.closed_loop() && right_.closed_loop();
        cycle.sample.angle_rad = angle_rad_;
        const bool deaf =
            start_ns - std::min(left_.feedback().encoder_time_ns, right_.feedback().encoder_time_ns) >
            gap_ns_;
        if (deaf && !deaf_ && left_.closed_loop() && right_.closed_loop()) {
            note("gap: no encoder frames for more than " + std::to_string(gap_ns_ / 1'000'000) +
                 " ms while torque is commanded: left out");
        }
        if (deaf_ && !deaf) pending_restart_ = true;
        deaf_ = deaf;
        cycle.sample.usable = cycle.sample.usable && !deaf;
        cycle.sample.last_torque_Nm = last_torque_;
        cycle.sample.heading_rad =
            (radius_.right * cycle.sample.angle_rad.right - radius_.left * cycle.sample.angle_rad.left) /
            track_m_;
        cycle.restart = restart || pending_restart_;
        pending_restart_ = false;
        if (cycle.sample.usable) {
            log_.turns.left =
                log_.turns.left || std::abs(cycle.sample.angle_rad.left - first_angle_.left) > 0.1;
            log_.turns.right =
                log_.turns.right || std::abs(cycle.sample.angle_rad.right - first_angle_.right) > 0.1;
        } else {
            first_angle_ = cycle.sample.angle_rad;
        }
        log_.cycles.push_back(cycle);
    }

    void finish() {
        log_.encoder_lag_s = {left_.encoder_lag_s(), right_.encoder_lag_s()};
        if (!log_.problems.empty()) return;
        const auto refuse = [this](std::string text) { log_.problems.push_back({0, std::move(text)}); };
        if (log_.frames == 0) {
            refuse("is empty");
        } else if (interface_.empty()) {
            refuse(
                "holds no torque command to the drives of the robot file: is it this robot's log, of the bus "
                "with the drives?");
        } else if (log_.cycles.empty()) {
            refuse("holds no cycle with commands to both drives");
        } else if (commands_ > 0 &&
                   std::abs(1e-9 * static_cast<double>(command_time_ns_) / static_cast<double>(commands_) -
                            task::kCyclePeriod_s) > kPeriodTolerance * task::kCyclePeriod_s) {
            refuse("torque commands come every " +
                   std::to_string(1e-6 * static_cast<double>(command_time_ns_) /
                                  static_cast<double>(commands_)) +
                   " ms, expected every millisecond");
        } else if (!log_.torque_changes.left && !log_.torque_changes.right) {
            refuse("the commanded torque never changes: nothing can be identified");
        } else if (!log_.turns.left && !log_.turns.right) {
            refuse("the wheels never turn while torque is commanded: nothing can be identified");
        } else if (log_.not_followed * 5 > log_.reports && log_.not_followed > 20) {
            log_.problems.push_back({log_.notes.empty() ? 0 : log_.notes.front().line,
                                     "the drives report another torque than commanded in " +
                                         std::to_string(log_.not_followed) + " of " +
                                         std::to_string(log_.reports) +
                                         " reports: saturated, or the torque constant is wrong"});
        }
    }

    DriveView left_, right_;
    WheelPair<double> radius_;
    double track_m_;
    std::int64_t before_command_ns_;
    std::int64_t age_ns_, gap_ns_;
    control::PlantModel<double> plant_;
    control::WheelObserver<double> observer_;
    DriveLog log_;
    std::string interface_;
    std::size_t line_ = 0;
    std::int64_t start_ns_ = 0, last_command_ns_ = 0;
    std::int64_t commands_ = 0, command_time_ns_ = 0;
    WheelPair<double> angle_rad_, last_torque_, first_angle_;
    bool pending_restart_ = true, deaf_ = true, followed_ = true;
};

}  // namespace

DriveLog read_drive_log(const std::string& path, const model::RobotParameters& robot) {
    std::ifstream in(path);
    if (!in) {
        DriveLog log;
        log.problems.push_back({0, std::string("cannot open: ") + std::strerror(errno)});
        return log;
    }
    // Once for what the log tells of the drives' encoder loops, once with them undone.
    DriveLog log = Reader(robot, {}).read(in);
    if (!log.problems.empty()) return log;
    in.clear();
    in.seekg(0);
    return Reader(robot, log.encoder_lag_s).read(in);
}

}  // namespace wheelwright::tools
