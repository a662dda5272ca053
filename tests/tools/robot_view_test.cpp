// What the monitor makes of telemetry.
#include <cstdio>
#include <set>
#include <string>

#include "firmware/protocol/wheelwright_messages.hpp"
#include "tools/cli/ident_words.hpp"
#include "tools/cli/report.hpp"
#include "tools/monitor/robot_view.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

template <typename Message>
hal::CanFrame frame_of(const Message& message) {
    hal::CanFrame frame;
    frame.id = Message::id;
    frame.length = Message::length;
    CHECK(message.encode(std::span(frame.data)) == protocol::CodecStatus::ok);
    return frame;
}

bool has(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_GROUP(RobotView){};

TEST(RobotView, DrivesThatAreNotArmedComeWithAdvice) {
    const auto advised = [](const protocol::Status& status, const char* words) {
        tools::RobotView view;
        CHECK(view.accept(frame_of(status), 0));
        return has(view.screen(0), words);
    };
    protocol::Status status;
    status.drive_left = protocol::DriveState::idle;
    status.drive_right = protocol::DriveState::other_generation;
    CHECK(advised(status, "left idle, right other_generation\n"));
    CHECK(advised(status,
                  "the right drive's frames are not those of the generation in the robot file: check "
                  "drive.generation\n"));
    status.drive_right = protocol::DriveState::idle;
    CHECK_FALSE(advised(status, "drive.generation"));
    status.state = protocol::Mode::fault;
    status.fault = protocol::Fault::arming_refused;
    status.blocker = protocol::Blocker::drives_not_armed;
    CHECK(advised(status, "a drive is heard and does not arm"));
    status.blocker = protocol::Blocker::watchdog_not_confirmed;
    CHECK(advised(status, "see drive.watchdog_assured and drive.watchdog_endpoint"));
}

TEST(RobotView, ADrivesErrorIsNamedByItsGeneration) {
    tools::RobotView view;
    protocol::Status status;
    status.state = protocol::Mode::idle;
    status.blocker = protocol::Blocker::drive_error;
    status.drive_right = protocol::DriveState::fault;
    CHECK(view.accept(frame_of(status), 0));
    protocol::DriveError error;
    error.wheel = protocol::Wheel::right;
    error.generation = 5;
    error.error = 0x4100;
    CHECK(view.accept(frame_of(error), 0));
    CHECK(has(view.screen(0), "the right drive reports encoder_failed, estop_requested (0x4100)\n"));
    CHECK(has(view.line(0), "blocked by drive_error (the right drive reports encoder_failed"));
    error.generation = 6;
    error.error = 0x02000000;
    error.wheel = protocol::Wheel::left;
    tools::DriveErrors errors;
    CHECK(errors.text().empty());
    errors.take(error);
    CHECK(
        tools::advice(status, errors) ==
        "the left drive reports estop_requested (0x2000000); remove the cause, then `wheelwright ctl clear`");
}

TEST(RobotView, APathThatIsStretchedIsSaidWithItsReason) {
    tools::RobotView view;
    CHECK(view.accept(frame_of(protocol::Status{}), 0));
    protocol::TrajectoryPace pace;
    pace.asked_period_s = pace.period_s = 10;
    CHECK(view.accept(frame_of(pace), 0));
    CHECK(has(view.screen(0), "path      figure_eight, period 10.00 s\n"));
    CHECK_FALSE(has(view.screen(0), "leaves room"));
    pace.period_s = 13.2;
    pace.limited_by = protocol::PaceLimit::torque;
    CHECK(view.accept(frame_of(pace), 0));
    CHECK(has(
        view.screen(0),
        "the period is 13.20 s in place of 10.00 s, so that limits.torque_Nm leaves room for feedback\n"));
}

TEST(RobotView, WhatTheIdentificationFoundAndChoseIsSaidWhenAllOfItIsKnown) {
    tools::RobotView view;
    CHECK(view.accept(frame_of(protocol::Status{}), 0));
    protocol::IdentStatus ident;
    ident.phase = protocol::IdentPhase::probing;
    CHECK(view.accept(frame_of(ident), 0));
    protocol::IdentSizing sizing;
    for (const protocol::IdentQuantity quantity : protocol::ident_quantity_values) {
        CHECK_FALSE(has(view.screen(0), "chosen:") && has(view.screen(0), "found:"));
        sizing.quantity = quantity;
        sizing.value = 0.25F * static_cast<float>(1 + int(quantity));
        CHECK(view.accept(frame_of(sizing), 0));
    }
    CHECK(has(view.screen(0),
              "chosen: 0.25 Nm in bits of 500 ms, averaged over 750 ms, up to 1 m/s and 1.25 rad/s"));
    CHECK(
        has(view.screen(0), "found: the wheels move at 2 Nm (left) and 2.25 Nm (right) and rub with 2.5 Nm"));
}

TEST(RobotView, ScreenNamesStateLimitsCountersAndModel) {
    tools::RobotView view;
    CHECK(has(view.screen(0), "nothing heard"));
    protocol::Status status;
    status.state = protocol::Mode::velocity;
    status.requested = protocol::Mode::velocity;
    status.limit_torque_left = true;
    status.limit_speed = true;
    status.drive_left = protocol::DriveState::armed;
    status.drive_right = protocol::DriveState::armed;
    CHECK(view.accept(frame_of(status), 1'000'000'000));
    CHECK(view.status_changed());
    CHECK_FALSE(view.status_changed());
    protocol::Counters counter;
    counter.cause = protocol::CounterCause::rejected_crc;
    counter.value = 7;
    CHECK(view.accept(frame_of(counter), 1'010'000'000));
    protocol::EstimateK5K7 estimate;
    estimate.k7_per_kg_m = 1.4085F;
    CHECK(view.accept(frame_of(estimate), 1'010'000'000));
    CHECK(view.accept(frame_of(protocol::EstimateK6K8{}), 1'010'000'000));
    protocol::EffectEstimate effect;
    effect.index = 0x4010;
    effect.value = 0.31F;
    CHECK(view.accept(frame_of(effect), 1'010'000'000));
    const std::string screen = view.screen(1'020'000'000);
    std::printf("%s", screen.c_str());
    CHECK(has(screen, "state     velocity\n"));
    CHECK(has(screen, "limiting  torque left, speed\n"));
    CHECK(has(screen, "left armed, right armed"));
    CHECK_FALSE(has(screen, "check drive.generation"));
    CHECK(has(screen, "counted   rejected_crc 7\n"));
    CHECK(has(screen, "K7 1.4085 1/(kg m)"));
    CHECK(has(screen, "coulomb_friction.left_Nm 0.31 Nm"));
    CHECK(has(view.screen(2'500'000'000), "SILENT for 1.5 s"));
}

TEST(RobotView, AnIdentificationsEndIsSaidInWords) {
    tools::RobotView view;
    protocol::Status status;
    status.blocker = protocol::Blocker::not_identified;
    CHECK(view.accept(frame_of(status), 0));
    CHECK(has(view.line(0), "not_identified, identify the robot first: wheelwright ctl mode ident"));
    protocol::IdentStatus ident;
    ident.phase = protocol::IdentPhase::probing;
    CHECK(view.accept(frame_of(ident), 0));
    CHECK(view.status_changed());
    CHECK_FALSE(has(view.screen(0), "not confirmed"));
    ident.phase = protocol::IdentPhase::stopped_by_limit;
    ident.cause = protocol::IdentCause::too_heavy;
    CHECK(view.accept(frame_of(ident), 0));
    CHECK(view.status_changed());
    CHECK(has(view.line(0), "too_heavy: neither wheel moved at limits.torque_Nm"));
    CHECK(has(view.screen(0), "raise it, or look for a brake or a blocked gear\n"));
    CHECK_FALSE(has(view.screen(0), "not confirmed"));
    ident.phase = protocol::IdentPhase::done;
    ident.cause = protocol::IdentCause::good_enough;
    ident.torque_clipped = true;
    CHECK(view.accept(frame_of(ident), 0));
    tools::Report report("monitor");
    view.fill(report);
    for (const std::string& text : {view.screen(0), report.text(), report.json()}) {
        CHECK(has(text, "left and right are not confirmed"));
        CHECK(has(text, "the drives deliver less than limits.torque_Nm; what they deliver is the limit now"));
    }
    CHECK(has(report.json(), "\"ident_cause\": \"good_enough\""));
}

TEST(RobotView, EachCauseHasItsWordsAndEachFailureItsRemedy) {
    std::set<std::string> seen;
    for (const protocol::IdentCause cause : protocol::ident_cause_values) {
        const tools::CauseWords words = tools::words_of(cause);
        CHECK_FALSE(words.happened.empty());
        CHECK(seen.insert(tools::cause_sentence(cause)).second);
        const bool fine = cause == protocol::IdentCause::none || cause == protocol::IdentCause::good_enough;
        CHECK_EQUAL(fine, words.change.empty());
    }
}

TEST(RobotView, BadAndForeignFramesAreCountedApart) {
    tools::RobotView view;
    hal::CanFrame frame = frame_of(protocol::Status{});
    frame.length = 6;
    CHECK_FALSE(view.accept(frame, 0));
    frame.id = 0x029;
    CHECK_FALSE(view.accept(frame, 1'000'000'000));
    frame.error = true;
    CHECK_FALSE(view.accept(frame, 1'000'000'000));
    tools::Report report("monitor");
    view.fill(report);
    const std::string json = report.json();
    CHECK(has(json, "\"bad\": 1"));
    CHECK(has(json, "\"last_error\": \"wrong_length\""));
    CHECK(has(json, "\"other_frames\": 1"));
    CHECK(has(json, "\"error_frames\": 1"));
    CHECK_FALSE(view.heard());
}
