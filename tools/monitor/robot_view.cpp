#include "tools/monitor/robot_view.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <span>
#include <utility>

#include "tools/cli/ident_words.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/cli/parameter_names.hpp"

namespace wheelwright::tools {
namespace {

// The firmware is taken for silent when Status is overdue by so much.
constexpr std::int64_t kSilent_ns = 500'000'000;

template <typename... Values>
std::string format(const char* pattern, Values... values) {
    std::array<char, 256> text{};
    std::snprintf(text.data(), text.size(), pattern, values...);
    return text.data();
}

template <typename Enum>
std::string name(Enum value) {
    return std::string(to_string_view(value));
}

std::string effect_name(std::uint16_t index) {
    const auto parameter = find_named_parameter(index);
    return parameter.has_value() ? parameter->key.substr(parameter->key.find('.') + 1)
                                 : format("0x%04X", unsigned{index});
}

std::string effect_unit(std::uint16_t index) {
    const auto parameter = find_named_parameter(index);
    return parameter.has_value() ? parameter->unit : "";
}

// "left 24.1 V, inverter 41 degC, motor not reported".
std::string health_text(const protocol::DriveHealth& health) {
    const auto reported = [](bool told, const char* pattern, double value) {
        return told ? format(pattern, value) : std::string("not reported");
    };
    return name(health.wheel) + " " + reported(health.supply_reported, "%.1f V", health.supply_V) +
           ", inverter " + reported(health.inverter_reported, "%.0f degC", health.inverter_temperature_degC) +
           ", motor " + reported(health.motor_reported, "%.0f degC", health.motor_temperature_degC);
}

}  // namespace

template <typename Message>
bool RobotView::take(const hal::CanFrame& frame, std::optional<Message>& into) {
    Message message;
    if (Message::decode(std::span(frame.data.data(), frame.length), message) != protocol::CodecStatus::ok) {
        return false;
    }
    into = message;
    return true;
}

bool RobotView::accept(const hal::CanFrame& frame, std::int64_t time_ns) {
    if (!any_) first_ns_ = time_ns;
    any_ = true;
    last_ns_ = time_ns;
    if (frame.error) {
        ++error_frames_;
        return false;
    }
    const std::optional<MessageText> text = describe(frame);
    if (!text.has_value()) {
        ++others_;
        return false;
    }
    Tally& tally = tally_[frame.id];
    ++tally.frames;
    if (!text->error.empty()) {
        ++tally.bad;
        tally.last_error = text->error;
        return false;
    }
    using namespace protocol;
    switch (frame.id) {
        case Status::id:
            status_ns_ = time_ns;
            return take(frame, status_);
        case Counters::id: {
            std::optional<Counters> counter;
            if (take(frame, counter)) counters_.at(static_cast<std::size_t>(counter->cause)) = counter->value;
            return counter.has_value();
        }
        case WheelState::id:
            return take(frame, wheels_);
        case Odometry::id:
            return take(frame, odometry_);
        case BodyState::id:
            return take(frame, body_);
        case TrackingError::id:
            return take(frame, tracking_);
        case EstimateK5K7::id:
            return take(frame, k5_k7_);
        case EstimateK6K8::id:
            return take(frame, k6_k8_);
        case StandardErrorK5K7::id:
            return take(frame, error_k5_k7_);
        case StandardErrorK6K8::id:
            return take(frame, error_k6_k8_);
        case EffectEstimate::id: {
            std::optional<EffectEstimate> estimate;
            if (take(frame, estimate)) effects_[estimate->index].value = estimate->value;
            return estimate.has_value();
        }
        case EffectStandardError::id: {
            std::optional<EffectStandardError> error;
            if (take(frame, error)) effects_[error->index].standard_error = error->value;
            return error.has_value();
        }
        case IdentStatus::id:
            return take(frame, ident_);
        case Timing::id:
            return take(frame, timing_);
        case BusLoad::id:
            return take(frame, bus_load_);
        case LoopDesign::id:
            return take(frame, design_);
        case TrajectoryPace::id:
            return take(frame, pace_);
        case DriveError::id: {
            std::optional<DriveError> error;
            if (take(frame, error)) drive_errors_.take(*error);
            return error.has_value();
        }
        case DriveHealth::id: {
            std::optional<DriveHealth> health;
            if (take(frame, health)) health_[std::size_t(health->wheel)] = health;
            return health.has_value();
        }
        case IdentSizing::id: {
            std::optional<IdentSizing> sizing;
            if (take(frame, sizing)) layout_.take(*sizing);
            return sizing.has_value();
        }
        default:
            return true;
    }
}

bool RobotView::status_changed() {
    if (!status_.has_value()) return false;
    std::string now = name(status_->state) + "," + name(status_->fault) + "," + name(status_->blocker);
    if (ident_.has_value()) now.append(",").append(to_string_view(ident_->cause));
    if (now == told_) return false;
    told_ = now;
    return true;
}

std::string RobotView::limits_text() const {
    std::string text;
    const auto add = [&](bool on, const char* what) {
        if (!on) return;
        if (!text.empty()) text += ", ";
        text += what;
    };
    add(status_->limit_torque_left, "torque left");
    add(status_->limit_torque_right, "torque right");
    add(status_->limit_speed, "speed");
    add(status_->limit_yaw_rate, "yaw rate");
    add(status_->limit_acceleration, "acceleration");
    add(status_->limit_area, "area");
    add(status_->limit_drives, "a drive's supply or temperature");
    add(status_->limit_adaptation_frozen, "adaptation frozen");
    return text.empty() ? "none" : text;
}

// Nothing while it runs.
std::vector<std::string> RobotView::ident_words() const {
    std::vector<std::string> lines;
    if (!ident_.has_value() || !ended(*ident_)) return lines;
    for (const std::string& line : {cause_sentence(ident_->cause), clipping_sentence(*ident_),
                                    sides_sentence(*ident_), model_sentence(*ident_)})
        if (!line.empty()) lines.push_back(line);
    return lines;
}

std::string RobotView::screen(std::int64_t now_ns) const {
    if (!status_.has_value()) return "nothing heard from a firmware yet\n";
    std::string out;
    const auto row = [&](const char* label, const std::string& text) {
        out += format("%-10s", label) + text + "\n";
    };
    const double age_s = static_cast<double>(now_ns - status_ns_) * 1e-9;
    row("state", name(status_->state) +
                     (status_->requested != status_->state ? ", asked for " + name(status_->requested) : "") +
                     (now_ns - status_ns_ > kSilent_ns ? format("   SILENT for %.1f s", age_s) : ""));
    row("fault", name(status_->fault) + (status_->cleared_by == protocol::Remedy::none
                                             ? ""
                                             : "   cleared by " + name(status_->cleared_by)));
    row("blocker", blocker_text(status_->blocker));
    row("limiting", limits_text());
    row("drives", "left " + name(status_->drive_left) + ", right " + name(status_->drive_right));
    if (const std::string text = drive_errors_.text(); !text.empty()) row("", text);
    if (const std::string text = advice(*status_, {}); !text.empty()) row("", text);
    for (const char* label = "supply"; const auto& health : health_) {
        if (health.has_value()) row(std::exchange(label, ""), health_text(*health));
    }
    if (odometry_.has_value()) {
        row("pose", format("x %8.4f m  y %8.4f m  heading %7.4f rad  (%s)", odometry_->x_m, odometry_->y_m,
                           odometry_->heading_rad, status_->pose_fixed ? "external pose" : "odometry alone"));
    }
    if (body_.has_value()) {
        row("motion", format("v %7.4f of %7.4f m/s   yaw rate %7.4f of %7.4f rad/s",
                             body_->forward_speed_m_per_s, body_->reference_forward_speed_m_per_s,
                             body_->yaw_rate_rad_per_s, body_->reference_yaw_rate_rad_per_s));
    }
    if (wheels_.has_value()) {
        row("wheels",
            format("left %8.3f rad/s %7.3f Nm   right %8.3f rad/s %7.3f Nm", wheels_->left_speed_rad_per_s,
                   wheels_->left_torque_Nm, wheels_->right_speed_rad_per_s, wheels_->right_torque_Nm));
    }
    if (tracking_.has_value()) {
        row("error", format("along %7.4f m  across %7.4f m  heading %7.4f rad%s", tracking_->along_m,
                            tracking_->across_m, tracking_->heading_rad,
                            status_->goal_reached ? "   goal reached" : ""));
    }
    if (pace_.has_value() && pace_->shape != protocol::TrajectoryShape::streamed) {
        const std::string words = pace_sentence(*pace_);
        row("path", name(pace_->shape) + format(", period %.2f s", pace_->period_s));
        if (!words.empty()) row("", words);
    }
    if (k5_k7_.has_value() && k6_k8_.has_value()) {
        const auto errors = [&](bool first) {
            if (!error_k5_k7_.has_value() || !error_k6_k8_.has_value()) return std::array<double, 2>{};
            return first ? std::array<double, 2>{error_k5_k7_->k5_m, error_k5_k7_->k7_per_kg_m}
                         : std::array<double, 2>{error_k6_k8_->k6_per_m, error_k6_k8_->k8_per_kg_m2};
        };
        row("model", "K7 " + with_error(k5_k7_->k7_per_kg_m, errors(true)[1]) + " 1/(kg m)   K8 " +
                         with_error(k6_k8_->k8_per_kg_m2, errors(false)[1]) + " 1/(kg m2)" +
                         (status_->model_trusted ? "   trusted" : "   not trusted"));
        row("", "K5 " + with_error(k5_k7_->k5_m, errors(true)[0]) + " m   K6 " +
                    with_error(k6_k8_->k6_per_m, errors(false)[0]) + " 1/m" +
                    (status_->excited ? "   excited" : ""));
    }
    for (const auto& [index, effect] : effects_) {
        const double error = effect.standard_error.value_or(0);
        row("effect", effect_name(index) + " " + with_error(static_cast<double>(effect.value), error) + " " +
                          effect_unit(index));
    }
    if (ident_.has_value() && ident_->phase != protocol::IdentPhase::off) {
        row("ident",
            name(ident_->phase) + format("  %.0f %%  delay %.3f ms  %u samples  excitation %.0f %%",
                                         status_->progress_percent, ident_->delay_s * 1e3,
                                         static_cast<unsigned>(ident_->samples), ident_->excitation_percent));
        for (const std::string& words : ident_words()) row("", words);
        for (const std::string& words : layout_.sentences()) row("", words);
    }
    if (design_.has_value()) {
        row("loops",
            format("Kp %.2f 1/s  Ki %.0f 1/s2  phase margin %.1f deg  Ms %.2f",
                   design_->proportional_gain_per_s, static_cast<double>(design_->integral_gain_per_s2),
                   design_->phase_margin_deg, design_->sensitivity_peak));
    }
    if (timing_.has_value()) {
        row("timing", format("wake-up %u us  execution %u us  missed cycles %u",
                             static_cast<unsigned>(timing_->wake_latency_max_us),
                             static_cast<unsigned>(timing_->execution_max_us),
                             static_cast<unsigned>(timing_->missed_cycles)));
    }
    if (bus_load_.has_value()) {
        row("bus", format("drives %.1f %%  host %.1f %%", bus_load_->drive_bus_load_percent,
                          bus_load_->host_bus_load_percent));
    }
    std::string counts;
    for (std::size_t i = 0; i < counters_.size(); ++i) {
        if (counters_[i].value_or(0) == 0) continue;
        if (!counts.empty()) counts += ", ";
        counts += name(protocol::counter_cause_values.at(i)) + " " + std::to_string(*counters_[i]);
    }
    row("counted", counts.empty() ? "nothing amiss" : counts);
    return out;
}

std::string RobotView::line(std::int64_t time_ns) const {
    std::string out = format("%10.3f s  ", static_cast<double>(time_ns - first_ns_) * 1e-9);
    if (!status_.has_value()) return out + "no Status yet";
    out += format("%-10s", name(status_->state).c_str());
    if (status_->fault != protocol::Fault::none) out += " fault " + name(status_->fault);
    if (status_->blocker != protocol::Blocker::none) out += " blocked by " + blocker_text(status_->blocker);
    if (status_->blocker == protocol::Blocker::drive_error || status_->fault == protocol::Fault::drive_error)
        out += " (" + drive_errors_.text() + ")";
    if (odometry_.has_value()) {
        out += format("  x %.4f y %.4f m heading %.4f rad", odometry_->x_m, odometry_->y_m,
                      odometry_->heading_rad);
    }
    if (body_.has_value()) {
        out += format("  v %.4f m/s yaw rate %.4f rad/s", body_->forward_speed_m_per_s,
                      body_->yaw_rate_rad_per_s);
    }
    if (ident_.has_value() && ident_->phase != protocol::IdentPhase::off) {
        out += "  ident " + name(ident_->phase) + format(" %.0f %%", status_->progress_percent);
        if (ended(*ident_))
            out += ", " + name(ident_->cause) + ": " + std::string(words_of(ident_->cause).happened);
    }
    return out;
}

void RobotView::fill(Report& report) const {
    const double duration_s = static_cast<double>(last_ns_ - first_ns_) * 1e-9;
    report.section("log", "Frames");
    report.add("duration_s", "duration", duration_s, "s");
    report.add("other_frames", "frames of others", static_cast<std::int64_t>(others_), "",
               "drives and the like");
    report.add("error_frames", "error frames", static_cast<std::int64_t>(error_frames_));
    report.table("messages", {{"name", "message"},
                              {"frames", "frames"},
                              {"rate_Hz", "a second"},
                              {"bad", "bad"},
                              {"last_error", "last error"}});
    for (const auto& [id, tally] : tally_) {
        const auto info = std::find_if(protocol::all_messages.begin(), protocol::all_messages.end(),
                                       [wanted = id](const auto& message) { return message.id == wanted; });
        report.row({std::string(info->name), static_cast<std::int64_t>(tally.frames),
                    duration_s > 0 ? static_cast<double>(tally.frames) / duration_s : 0.0,
                    static_cast<std::int64_t>(tally.bad), tally.last_error});
    }
    if (!status_.has_value()) return;
    report.section("last", "At the end");
    report.add("state", "state", name(status_->state));
    report.add("fault", "fault", name(status_->fault));
    report.add("blocker", "blocker", name(status_->blocker));
    if (ident_.has_value() && ended(*ident_)) {
        report.add("ident_cause", "identification", name(ident_->cause));
        report.table("ident_words", {{"words", "identification in words"}});
        for (std::string words : ident_words()) report.row({std::move(words)});
    }
    if (const std::string text = drive_errors_.text(); !text.empty())
        report.add("drive_errors", "drives", text);
    if (const auto found = layout_.sentences(); !found.empty()) {
        report.table("ident_layout", {{"words", "what the identification found and chose"}});
        for (std::string words : found) report.row({std::move(words)});
    }
    if (pace_.has_value()) {
        report.add("path_period_s", "period of the path", pace_->period_s, "s", pace_sentence(*pace_));
    }
    report.add("limiting", "limiting", limits_text());
    if (odometry_.has_value()) {
        report.add("x_m", "x", odometry_->x_m, "m");
        report.add("y_m", "y", odometry_->y_m, "m");
        report.add("heading_rad", "heading", odometry_->heading_rad, "rad");
    }
    if (k5_k7_.has_value() && k6_k8_.has_value()) {
        report.add("k5_m", "K5", static_cast<double>(k5_k7_->k5_m), "m");
        report.add("k6_per_m", "K6", static_cast<double>(k6_k8_->k6_per_m), "1/m");
        report.add("k7_per_kg_m", "K7", static_cast<double>(k5_k7_->k7_per_kg_m), "1/(kg m)");
        report.add("k8_per_kg_m2", "K8", static_cast<double>(k6_k8_->k8_per_kg_m2), "1/(kg m2)");
    }
    if (error_k5_k7_.has_value() && error_k6_k8_.has_value()) {
        report.add("k7_standard_error_per_kg_m", "standard error of K7",
                   static_cast<double>(error_k5_k7_->k7_per_kg_m), "1/(kg m)");
        report.add("k8_standard_error_per_kg_m2", "standard error of K8",
                   static_cast<double>(error_k6_k8_->k8_per_kg_m2), "1/(kg m2)");
    }
    report.section("counters", "Counted");
    for (std::size_t i = 0; i < counters_.size(); ++i) {
        if (!counters_[i].has_value()) continue;
        const std::string cause = name(protocol::counter_cause_values.at(i));
        report.add(cause, cause, static_cast<std::int64_t>(*counters_[i]));
    }
}

}  // namespace wheelwright::tools
