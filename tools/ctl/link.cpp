#include "tools/ctl/link.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "firmware/supervisor/modes.hpp"
#include "firmware/task/arming_guard.hpp"
#include "firmware/task/key_file.hpp"
#include "hal/linux/cryptography.hpp"
#include "tools/cli/ident_words.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
// Alive counters of separate calls come from the clock, one step in so many nanoseconds; a round of 15 is
// longer than the 500 ms over which the firmware remembers the last one.
constexpr std::int64_t kAliveSlot_ns = 40'000'000;
constexpr std::int64_t kLongestArming_ns = 4 * kSecond_ns;
// After an answer: the firmware has judged it and said so.
constexpr std::int64_t kJudged_ns = kSecond_ns / 4;
constexpr std::int64_t kAlivePeriod_ns = std::int64_t{protocol::HostAlive::cycle_time_ms} * 1'000'000;

}  // namespace

int LinkOptions::complain(int status, const std::string& text) const {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), text.c_str());
    return status;
}

int Link::open() {
    int status = read_key();
    if (status != kDone) return status;
    first_alive_ = options_.alive >= 0 ? static_cast<std::uint8_t>(options_.alive) : alive_of_slot();
    bus_ = open_can(options_.interface, status);
    if (bus_ != nullptr) {
        constexpr std::uint32_t kWhole = 0x7FF;
        std::vector<hal::CanFilter> filters;
        for (const std::uint32_t id :
             {protocol::Status::id, protocol::BodyState::id, protocol::ParameterReply::id,
              protocol::IdentStatus::id, protocol::EstimateK5K7::id, protocol::EstimateK6K8::id,
              protocol::StandardErrorK5K7::id, protocol::StandardErrorK6K8::id, protocol::DriveError::id,
              protocol::TrajectoryPace::id, protocol::IdentSizing::id, protocol::ArmingChallenge::id})
            filters.push_back({id, kWhole, false});
        bus_->set_filters(filters);
    }
    return status;
}

void Link::leave_slot() { sleep_until((can_now_ns() / kAliveSlot_ns + 1) * kAliveSlot_ns); }

bool Link::receive(hal::CanFrame& frame, std::int64_t deadline_ns) {
    hal::ReceivedFrame received;
    while (!interrupted()) {
        if (stays_alive_ && can_now_ns() >= alive_due_ns_) {
            if (send(command_of(protocol::HostAlive{})) != kDone) return false;
            alive_due_ns_ = can_now_ns() + kAlivePeriod_ns;
        }
        const std::int64_t until_ns = stays_alive_ ? std::min(deadline_ns, alive_due_ns_) : deadline_ns;
        if (!receive_until(*bus_, received, until_ns)) {
            if (can_now_ns() >= deadline_ns) return false;
            continue;
        }
        frame = received.frame;
        if (frame.extended || frame.error || frame.remote) continue;
        if (const auto body = decoded<protocol::BodyState>(frame)) body_ = *body;
        if (const auto status = decoded<protocol::Status>(frame); status && status->requested == wanted_)
            taken_ = true;
        if (const auto error = decoded<protocol::DriveError>(frame)) errors_.take(*error);
        if (const auto challenge = decoded<protocol::ArmingChallenge>(frame);
            challenge && !answer(*challenge))
            return false;
        return true;
    }
    return false;
}

int Link::send(const Command& command) {
    hal::CanFrame frame;
    if (const std::string wrong = command.make(next_alive(command), frame); !wrong.empty()) {
        return options_.complain(kUsage, wrong);
    }
    if (const std::string failed = send_frame(*bus_, frame); !failed.empty()) {
        return options_.complain(kMachineLacks, options_.interface + ": " + failed);
    }
    return kDone;
}

int Link::read_key() {
    if (options_.key.empty()) return kDone;
    task::KeyFile file;
    if (const std::string wrong = task::read_key_file(options_.key, file); !wrong.empty()) {
        return options_.complain(kUsage, wrong);
    }
    auto made = hal::make_aes_cmac(file.key);
    if (!made) return options_.complain(made.error().exit_status(), made.error().message);
    code_ = std::move(made.value());
    robot_ = file.robot;
    return kDone;
}

int Link::ask(protocol::Mode mode) {
    wanted_ = mode;
    wanted_ns_ = can_now_ns();
    taken_ = false;
    asked_.reset();
    if (code_ != nullptr && supervisor::drives(mode)) asked_ = mode;
    answered_ns_ = 0;
    return send(mode_command(mode));
}

// Once each: somebody else may have asked for it too. False: it cannot be sent.
bool Link::answer(const protocol::ArmingChallenge& challenge) {
    const bool again = answered_ns_ != 0 && challenge.nonce_low == answered_.nonce_low &&
                       challenge.nonce_high == answered_.nonce_high;
    if (!asked_ || again) return true;
    const auto right = task::answer_to(challenge, *asked_, {code_.get(), nullptr, robot_});
    answered_ = challenge;
    answered_ns_ = can_now_ns();
    return right && send(command_of(*right)) == kDone;
}

void Link::prove() {
    const std::int64_t last_ns = can_now_ns() + longest_arming_ns();
    const std::int64_t settled_ns = can_now_ns() + kJudged_ns;
    while (asked_ && answered_ns_ == 0) {
        const auto status = wait_for<protocol::Status>(last_ns);
        if (!status || status->requested == *asked_) return;
        if (can_now_ns() > settled_ns && !keeps_trying(*status)) return;
    }
}

bool Link::keeps_trying(const protocol::Status& status) {
    using protocol::Blocker;
    using protocol::DriveState;
    // No blocker: it was lost, or had the counter of another host's request just before. What was requested
    // for a moment has been taken back by another host, which has the last word.
    const bool lost = status.blocker == Blocker::none && !taken_;
    const bool refused = (status.blocker == Blocker::drives_not_armed || lost) &&
                         status.state == protocol::Mode::idle && status.requested != wanted_;
    const bool heard = status.drive_left != DriveState::silent && status.drive_right != DriveState::silent;
    if (refused && heard && can_now_ns() > wanted_ns_ + kJudged_ns) return ask(wanted_) == kDone;
    if (status.blocker == Blocker::not_authenticated) {
        return asked_.has_value() && (answered_ns_ == 0 || can_now_ns() < answered_ns_ + kJudged_ns);
    }
    return status.blocker == Blocker::drives_not_armed || status.blocker == Blocker::none;
}

std::int64_t Link::longest_arming_ns() const {
    const std::int64_t challenge_ns = task::ArmingGuard::kMostDelay_ns + task::ArmingGuard::kValid_ns;
    return kLongestArming_ns + (asked_ ? challenge_ns : 0);
}

std::string Link::text_of(const protocol::Status& status) const {
    const bool refused = status.blocker == protocol::Blocker::not_authenticated && answered_ns_ != 0;
    return status_text(status, errors_) +
           (refused ? "; the answer was refused: is this key the robot's?" : "");
}

void Link::forget_received() {
    hal::ReceivedFrame received;
    for (int i = 0; i < 100'000 && bus_->receive(received) == hal::CanStatus::ok; ++i) {
    }
}

std::uint8_t Link::alive_of_slot() {
    return static_cast<std::uint8_t>((can_now_ns() / kAliveSlot_ns) % std::int64_t{protocol::alive_count});
}

// Set-points count up. What comes once has the counter of its slot, and each slot serves one such frame
// of a kind, so that no call repeats what another one has sent just before.
std::uint8_t Link::next_alive(const Command& command) {
    for (auto& [known, alive] : alive_) {
        if (known != command.name) continue;
        if (command.period_s > 0 || options_.alive >= 0) return alive = protocol::next_alive(alive);
        while (alive_of_slot() == alive) leave_slot();
        return alive = alive_of_slot();
    }
    // Frames that belong together begin with one counter.
    const bool counts = command.period_s > 0 || options_.alive >= 0;
    const std::uint8_t first = counts ? first_alive_ : alive_of_slot();
    alive_.emplace_back(command.name, first);
    return first;
}

std::optional<protocol::ParameterReply> Link::ask(protocol::ParameterOperation operation, std::uint16_t index,
                                                  float value, int& status) {
    using protocol::ParameterOperation;
    forget_received();
    for (int attempt = 0; attempt < 3; ++attempt) {
        status = send(parameter_request(operation, index, value));
        if (status != kDone) return std::nullopt;
        const std::int64_t deadline_ns = can_now_ns() + kSecond_ns / 4;
        while (const auto reply = wait_for<protocol::ParameterReply>(deadline_ns)) {
            const bool about_this =
                operation == ParameterOperation::read || operation == ParameterOperation::write
                    ? reply->index == index
                    : true;
            if (reply->operation != operation || !about_this) continue;
            if (reply->result != protocol::ParameterResult::save_started) return reply;
            const auto later = wait_for<protocol::ParameterReply>(can_now_ns() + 10 * kSecond_ns);
            if (!later.has_value()) {
                status = options_.complain(kAimMissed, "save: begun, but its end was not reported");
            }
            return later;
        }
        if (interrupted()) break;
    }
    status = options_.complain(kAimMissed, "no reply came back: is the firmware running there?");
    return std::nullopt;
}

bool ModeWatch::follow(Link& link, std::int64_t deadline_ns) {
    while (const auto status = link.wait_for<protocol::Status>(deadline_ns)) {
        last_ = status;
        heard_ns_ = can_now_ns();
        if (status->state == wanted_) {
            entered_ = true;
        } else if (entered_) {
            return false;
        } else if (heard_ns_ > asked_ns_ + kSecond_ns / 4) {
            if (!link.keeps_trying(*status) || heard_ns_ > asked_ns_ + link.longest_arming_ns()) return false;
        }
    }
    return true;
}

bool ModeWatch::silent() const {
    return can_now_ns() > (last_.has_value() ? heard_ns_ : asked_ns_) + kSecond_ns / 2;
}

int ModeWatch::result(const Link& link) const {
    const LinkOptions& options = link.options();
    if (!last_.has_value()) {
        return options.complain(kAimMissed,
                                "sent, but no Status frame came back: is the firmware running there?");
    }
    if (silent()) {
        return options.complain(kAimMissed, "the firmware has gone: its Status frames have ceased");
    }
    if (last_->state == wanted_) return kDone;
    return options.complain(kAimMissed,
                            std::string(entered_ ? "the robot has left " : "the robot did not enter ") +
                                std::string(to_string_view(wanted_)) + ": " + link.text_of(*last_));
}

Command mode_command(protocol::Mode mode) {
    protocol::ModeCommand message;
    message.mode = mode;
    return command_of(message);
}

Command parameter_request(protocol::ParameterOperation operation, std::uint16_t index, float value) {
    protocol::ParameterRequest message;
    message.operation = operation;
    message.index = index;
    message.value = value;
    return command_of(message);
}

std::string status_text(const protocol::Status& status, const DriveErrors& errors) {
    std::string text = "state " + std::string(to_string_view(status.state));
    if (status.fault != protocol::Fault::none) text += ", fault " + std::string(to_string_view(status.fault));
    if (status.blocker != protocol::Blocker::none) {
        text += ", blocked by " + blocker_text(status.blocker);
    }
    if (const std::string more = advice(status, errors); !more.empty()) text += "; " + more;
    return text;
}

std::string result_text(protocol::ParameterResult result) {
    using protocol::ParameterResult;
    std::string text(to_string_view(result));
    if (result == ParameterResult::read_only) text += ": only the robot file sets it, at the start";
    if (result == ParameterResult::not_now) text += ": it may change in the idle mode only";
    if (result == ParameterResult::save_failed) text += ": wheelwrightd has said why where it runs";
    if (result == ParameterResult::nothing_staged) text += ": write parameters first";
    return text;
}

float float_within(double value, double minimum, double maximum) {
    auto single = static_cast<float>(value);
    if (static_cast<double>(single) > maximum) single = std::nextafter(single, -HUGE_VALF);
    if (static_cast<double>(single) < minimum) single = std::nextafter(single, HUGE_VALF);
    return single;
}

}  // namespace wheelwright::tools
