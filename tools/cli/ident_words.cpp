#include "tools/cli/ident_words.hpp"

#include <array>

#include "tools/cli/report.hpp"

namespace wheelwright::tools {
namespace {

using protocol::IdentCause;

struct Row {
    IdentCause cause;
    CauseWords words;
};

// In the order of the DBC's table.
constexpr std::array<Row, protocol::ident_cause_values.size()> kCauses{{
    {IdentCause::none, {"not run to an end yet", ""}},
    {IdentCause::good_enough, {"K5 to K8 are known well enough", ""}},
    {IdentCause::coupling_not_known,
     {"K7 and K8 are known and kept, K5 and K6 are not yet and stay as they were",
      "for these a longer ident.duration_s, or a higher ident.yaw_rate_limit_rad_per_s"}},
    {IdentCause::time_over,
     {"time was up before K7 and K8, or left and right, were known well enough",
      "a longer ident.duration_s, more room (ident.distance_limit_m) or a higher ident.speed_limit_m_per_s"}},
    {IdentCause::area_left,
     {"the robot was farther from its start than ident.distance_limit_m",
      "give it more room and say so there, or lower ident.speed_limit_m_per_s; a wheel that slips looks "
      "alike"}},
    {IdentCause::too_fast,
     {"the robot was a third faster than ident.speed_limit_m_per_s or ident.yaw_rate_limit_rad_per_s",
      "leave ident.amplitude_Nm and ident.bit_time_s at \"auto\", or lower them; a wheel that slips looks "
      "alike"}},
    {IdentCause::delay_not_found,
     {"the delay from torque command to torque could not be measured",
      "a longer ident.delay_phase_s, or look for encoder frames that come irregularly and wheels that slip"}},
    {IdentCause::interrupted,
     {"a stop, a fault or another mode came before the end", "clear what stopped it, and begin again"}},
    {IdentCause::not_at_rest,
     {"the robot moved before any torque was given", "let it stand by itself on level floor, hands off"}},
    {IdentCause::too_heavy,
     {"neither wheel moved at limits.torque_Nm", "raise it, or look for a brake or a blocked gear"}},
    {IdentCause::left_wheel_does_not_turn,
     {"the right wheel turned, the left one did not",
      "look for a brake, a blocked gear, an obstacle, a motor cable or a still encoder at the left wheel"}},
    {IdentCause::right_wheel_does_not_turn,
     {"the left wheel turned, the right one did not",
      "look for a brake, a blocked gear, an obstacle, a motor cable or a still encoder at the right wheel"}},
    {IdentCause::left_wheel_against_torque,
     {"the left wheel's encoder counts against its motor's torque",
      "calibrate the left drive's motor and encoder again; on a slope, begin on level floor"}},
    {IdentCause::right_wheel_against_torque,
     {"the right wheel's encoder counts against its motor's torque",
      "calibrate the right drive's motor and encoder again; on a slope, begin on level floor"}},
    {IdentCause::left_wheel_off_ground,
     {"the left wheel turns without moving the robot",
      "put it on the floor; a loose hub or a slippery floor looks alike; seldom a weak right drive or "
      "a weight far to the right, which an external pose tells from it"}},
    {IdentCause::right_wheel_off_ground,
     {"the right wheel turns without moving the robot",
      "put it on the floor; a loose hub or a slippery floor looks alike; seldom a weak left drive or "
      "a weight far to the left, which an external pose tells from it"}},
    {IdentCause::left_sign_wrong,
     {"told to drive straight on, the robot turned: the left wheel goes backwards",
      "change drive.left.sign"}},
    {IdentCause::right_sign_wrong,
     {"told to drive straight on, the robot turned: the right wheel goes backwards",
      "change drive.right.sign"}},
    {IdentCause::both_signs_wrong,
     {"told to drive forwards, the robot went backwards", "change drive.left.sign and drive.right.sign"}},
    {IdentCause::wheels_swapped,
     {"drive.left drives the right wheel",
      "exchange drive.left.node and drive.right.node (and their signs)"}},
    {IdentCause::no_room,
     {"in this room the robot may only move so slowly that its friction or its encoders' noise hides it, "
      "or even the gentle pushes of the probe leave it",
      "more room (ident.distance_limit_m), higher ident.speed_limit_m_per_s and yaw_rate_limit_rad_per_s"}},
    {IdentCause::torque_not_followed,
     {"a drive reports less torque than it was told, or delivers too little to move the robot well",
      "lower ident.amplitude_Nm, or look at the drive's current limit, temperature and supply"}},
    {IdentCause::model_incomplete,
     {"the model leaves so much of the motion unexplained that its numbers cannot be trusted",
      "look whether both wheels turn the robot the way drive.left.sign and drive.right.sign say, and run "
      "`wheelwright gap` on the log of this run"}},
    {IdentCause::one_sign_wrong,
     {"the robot moves like its mirror image: one wheel goes backwards, which one the wheels cannot tell",
      "look which one, and change its drive.left.sign or drive.right.sign"}},
    {IdentCause::direction_unverified,
     {"K5 to K8 are known for what the wheels report, but one wheel may go backwards: the centre of "
      "gravity is too near the axle to show it, and there was no external pose",
      "drive slowly first, and watch which way the robot goes; if it turns instead of driving straight "
      "on, change drive.left.sign or drive.right.sign and identify again"}},
}};

constexpr bool in_order() {
    for (std::size_t i = 0; i < kCauses.size(); ++i)
        if (kCauses[i].cause != protocol::ident_cause_values[i]) return false;
    return true;
}
static_assert(in_order(), "every cause of the DBC has its words, at its place");

}  // namespace

CauseWords words_of(IdentCause cause) { return kCauses.at(static_cast<std::size_t>(cause)).words; }

std::string cause_sentence(IdentCause cause) {
    const CauseWords words = words_of(cause);
    std::string text(words.happened);
    if (!words.change.empty()) text.append(": ").append(words.change);
    return text;
}

std::string_view words_of(protocol::IdentPhase phase) {
    using protocol::IdentPhase;
    switch (phase) {
        case IdentPhase::off:
            return "not begun";
        case IdentPhase::probing:
            return "trying gently what robot this is";
        case IdentPhase::measuring_delay:
            return "measuring the delay";
        case IdentPhase::estimating:
            return "estimating";
        case IdentPhase::done:
            return "done";
        case IdentPhase::stopped_by_limit:
            return "failed";
    }
    return "";
}

std::string blocker_text(protocol::Blocker blocker) {
    std::string text(to_string_view(blocker));
    if (blocker == protocol::Blocker::not_identified)
        text += ", identify the robot first: wheelwright ctl mode ident";
    if (blocker == protocol::Blocker::not_authenticated)
        text += ", the robot is armed with its key only: wheelwright ctl --key FILE";
    return text;
}

std::string clipping_sentence(const protocol::IdentStatus& status, const TorqueLimit& limit) {
    if (!status.torque_clipped) return "";
    const bool known = limit.delivered_Nm > 0 && limit.delivered_Nm < limit.asked_Nm;
    if (!known)
        return std::string("the drives deliver less than limits.torque_Nm") +
               (identified(status) ? "; what they deliver is the limit now" : "");
    const std::string delivered = number_text(limit.delivered_Nm, 3) + " Nm";
    return "the drives deliver " + delivered + " of the " + number_text(limit.asked_Nm, 3) +
           " Nm of limits.torque_Nm" + (identified(status) ? "; " + delivered + " is the limit now" : "");
}

std::string sides_sentence(const protocol::IdentStatus& status) {
    if (!identified(status) || status.sides_confirmed) return "";
    return std::string("left and right are not confirmed: ") +
           (status.signs_agree
                ? "wheels swapped or both signs wrong cannot be seen without an external pose; look"
                : "wheels swapped or wrong signs cannot be seen without an external pose; look");
}

std::string model_sentence(const protocol::IdentStatus& status) {
    if (!identified(status) || !status.model_incomplete) return "";
    return "the robot does something that the model does not know: wheelwright gap on this run's log says "
           "what";
}

std::optional<double> IdentLayout::operator[](protocol::IdentQuantity quantity) const {
    const auto value = static_cast<double>(value_.at(std::size_t(quantity)));
    return value == 0 ? std::nullopt : std::optional(value);
}

std::vector<std::string> IdentLayout::sentences() const {
    using enum protocol::IdentQuantity;
    bool known = true;
    const auto number = [&](protocol::IdentQuantity quantity, double scale = 1) {
        const auto value = (*this)[quantity];
        known = known && value.has_value();
        return number_text(scale * value.value_or(0), 3);
    };
    std::vector<std::string> lines;
    const auto add = [&](const std::string& line) {
        if (known) lines.push_back(line);
        known = true;
    };
    add("found: the wheels move at " + number(left_breakaway) + " Nm (left) and " + number(right_breakaway) +
        " Nm (right) and rub with " + number(friction) + " Nm; K7 about " + number(rough_k7) +
        " 1/(kg m), K8 about " + number(rough_k8) + " 1/(kg m^2); " + number(delivered_torque) +
        " Nm delivered when tried, and reported as " + number(report_ratio) + " of it; angle noise " +
        number(angle_noise, 1e3) + " mrad");
    add("chosen: " + number(amplitude) + " Nm in bits of " + number(bit_time, 1e3) + " ms, averaged over " +
        number(kernel, 1e3) + " ms, up to " + number(speed_limit) + " m/s and " + number(yaw_rate_limit) +
        " rad/s; K5 to be known to " + number(coupling_standard_error, 1e3) + " mm");
    return lines;
}

}  // namespace wheelwright::tools
