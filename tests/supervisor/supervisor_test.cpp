// The supervisor's life in some stories. enumeration_test.cpp has every state with every pair of events.
#include <array>
#include <cstdint>

#include "firmware/supervisor/supervisor.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright::supervisor;

namespace {

constexpr std::array kDrivingModes{Mode::torque, Mode::ident,      Mode::velocity,
                                   Mode::pose,   Mode::trajectory, Mode::adaptive};

Conditions healthy() {
    Conditions c;
    c.rolling = false;
    c.watchdog_confirmed = true;
    c.velocity_design_accepted = true;
    c.model_known = true;
    c.model_trusted = true;
    return c;
}

Conditions armed() {
    Conditions c = healthy();
    c.drives_armed = true;
    return c;
}

Conditions in_motion() {
    Conditions c = armed();
    c.moving = c.rolling = true;
    return c;
}

Supervisor driving(Mode mode, SupervisorConfig config = {}) {
    Supervisor s(config);
    CHECK_FALSE(s.step(healthy(), {false, mode}).refused);
    CHECK(s.step(armed()).entry == Entry::from_rest);
    CHECK(s.mode() == mode);
    CHECK(s.may_drive());
    return s;
}

}  // namespace

TEST_GROUP(SupervisorEntry){};

TEST(SupervisorEntry, permission_is_off_at_start) {
    Supervisor s({});
    CHECK(s.mode() == Mode::boot);
    CHECK_FALSE(s.wants_armed());
    for (int i = 0; i < 10; ++i) CHECK(s.step(armed()).owner == Owner::nobody);
    CHECK(s.mode() == Mode::idle);
    CHECK_FALSE(s.wants_armed());
}

TEST(SupervisorEntry, a_driving_mode_arms_first_and_drives_only_when_both_drives_follow) {
    for (Mode mode : kDrivingModes) {
        Supervisor s({});
        CHECK(s.step(healthy(), {false, mode}).order == DriveOrder::arm);
        for (int i = 0; i < 50; ++i) {
            CHECK(s.step(healthy()).owner == Owner::nobody);
            CHECK(s.mode() == Mode::idle);
            CHECK(s.wants_armed());
        }
        CHECK(s.step(armed()).entry == Entry::from_rest);
        CHECK(s.may_drive());
        CHECK(s.step(armed()).entry == Entry::none);
    }
}

TEST(SupervisorEntry, between_driving_modes_the_drives_stay_armed) {
    Supervisor s = driving(Mode::torque);
    const Verdict verdict = s.step(armed(), {false, Mode::velocity});
    CHECK(verdict.mode == Mode::velocity);
    CHECK(verdict.entry == Entry::from_driving);
    CHECK(verdict.owner == Owner::law);
    CHECK(verdict.order == DriveOrder::none);
}

TEST(SupervisorEntry, what_a_request_rested_on_is_looked_at_again_when_the_drives_are_armed) {
    Supervisor s({});
    s.step(healthy(), {false, Mode::adaptive});
    Conditions c = armed();
    c.model_trusted = false;
    CHECK(s.step(c).order == DriveOrder::disarm);
    CHECK(s.mode() == Mode::idle);
    CHECK(s.blocker() == Blocker::model_not_trusted);
}

TEST(SupervisorEntry, arming_that_takes_too_long_or_is_refused_is_a_fault_that_says_why) {
    SupervisorConfig config;
    config.arming_limit_cycles = 20;
    Supervisor slow(config);
    for (int i = 0; i < 20; ++i) slow.step(healthy(), {false, Mode::torque});  // asked for again and again
    CHECK(slow.phase() == Phase::arming);
    slow.step(healthy(), {false, Mode::torque});
    CHECK(slow.fault() == Fault::arming_refused);
    CHECK(slow.blocker() == Blocker::drives_not_armed);

    Supervisor unguarded({});
    Conditions c = healthy();
    c.watchdog_confirmed = false;
    unguarded.step(c, {false, Mode::torque});
    c.arming_refused = true;
    CHECK(unguarded.step(c).order == DriveOrder::disarm);
    CHECK(unguarded.fault() == Fault::arming_refused);
    CHECK(unguarded.blocker() == Blocker::watchdog_not_confirmed);
}

TEST(SupervisorEntry, idle_from_motion_brakes_first_and_a_set_point_that_ends_is_no_fault) {
    Supervisor s = driving(Mode::velocity);
    Conditions c = in_motion();
    CHECK(s.step(c, {false, Mode::idle}).begins_braking);
    c.command_stale = true;
    for (int i = 0; i < 100; ++i) {
        CHECK(s.step(c).owner == Owner::brake);
        CHECK(s.wants_armed());
    }
    c.moving = c.rolling = false;
    CHECK(s.step(c).order == DriveOrder::disarm);
    CHECK(s.mode() == Mode::idle);
}

TEST(SupervisorEntry, a_finished_identification_returns_to_idle_but_not_the_mode_that_follows_it) {
    Conditions c = in_motion();
    c.mode_finished = true;
    Supervisor s = driving(Mode::ident);
    CHECK(s.step(c).owner == Owner::brake);
    c.moving = c.rolling = false;
    s.step(c);
    CHECK(s.mode() == Mode::idle);
    CHECK(s.fault() == Fault::none);

    Supervisor goes_on = driving(Mode::ident);
    CHECK(goes_on.step(c, {false, Mode::velocity}).owner == Owner::law);
    CHECK(goes_on.mode() == Mode::velocity);
}

TEST_GROUP(SupervisorFaults){};

TEST(SupervisorFaults, an_emergency_stop_is_remembered_and_its_ramp_goes_on) {
    for (const bool ramps : {false, true}) {
        for (const auto what : {&Conditions::stop_message, &Conditions::stop_line_active}) {
            SupervisorConfig config;
            config.stops.emergency_stop_ramps = ramps;
            config.stops.stale_command_ramps = true;
            Supervisor s = driving(Mode::velocity, config);
            Conditions c = in_motion();
            c.command_stale = true;
            CHECK(s.step(c).owner == Owner::brake);
            c.*what = true;
            s.step(c);
            s.step(c);
            CHECK_EQUAL(ramps, s.ramping());
            CHECK(s.fault() == (what == &Conditions::stop_message ? Fault::emergency_stop_message
                                                                  : Fault::emergency_stop_line));
        }
    }
}

// A stop message comes once: beside a fault that was looked at first, it was lost.
TEST(SupervisorFaults, a_stop_message_beside_another_fault_is_not_lost) {
    Supervisor s = driving(Mode::velocity);
    Conditions c = in_motion();
    c.stop_message = c.not_finite = true;
    s.step(c);
    CHECK(s.fault() == Fault::emergency_stop_message);
}

// Of two causes in one cycle the first gave the reaction: it began to brake over a bus that was down.
TEST(SupervisorFaults, braking_needs_the_leave_of_everything_that_is_wrong) {
    SupervisorConfig config;
    config.stops = {true, true, true, true, true};
    for (const auto what : {&Conditions::bus_down, &Conditions::feedback_stale, &Conditions::drive_error}) {
        Supervisor s = driving(Mode::velocity, config);
        Conditions c = in_motion();
        c.stop_line_active = true;
        c.*what = true;
        CHECK(s.step(c).owner == Owner::nobody);
        CHECK(s.fault() == Fault::emergency_stop_line);
    }
}

TEST(SupervisorFaults, a_fault_stays_until_cleared_at_rest_and_says_what_clears_it) {
    Supervisor s = driving(Mode::velocity);
    Conditions c = in_motion();
    c.stop_line_active = true;
    s.step(c);
    c.stop_line_active = false;
    const auto refused = [&](Blocker blocker, Remedy remedy) {
        s.step(c, {true, {}});
        CHECK(s.mode() == Mode::fault);
        CHECK(s.blocker() == blocker);
        CHECK(s.cleared_by() == remedy);
    };
    for (int i = 0; i < 1000; ++i) refused(Blocker::robot_moving, Remedy::standstill);
    c.moving = c.rolling = false;
    c.stop_line_active = true;
    refused(Blocker::stop_line_active, Remedy::release_stop_line);
    c.stop_line_active = false;
    c.bus_down = true;
    refused(Blocker::fault_latched, Remedy::restore_bus);
    c.terminate = true;
    refused(Blocker::fault_latched, Remedy::restart);
    c.terminate = c.bus_down = false;
    for (Mode mode : kDrivingModes) {
        CHECK(s.step(c, {false, mode}).refused);
        CHECK(s.blocker() == Blocker::fault_latched);
        CHECK(s.cleared_by() == Remedy::clear_fault);
    }
    CHECK(s.step(c, {true, {}}).clear_drive_errors);
    CHECK(s.mode() == Mode::idle);
    CHECK(s.fault() == Fault::none);
    CHECK_FALSE(s.wants_armed());
}

TEST(SupervisorFaults, a_configured_ramp_brakes_and_then_coasts) {
    struct Case {
        bool StopChoices::*choice;
        bool Conditions::*what;
    };
    for (const Case& one : {Case{&StopChoices::stale_command_ramps, &Conditions::command_stale},
                            Case{&StopChoices::over_speed_ramps, &Conditions::over_speed},
                            Case{&StopChoices::emergency_stop_ramps, &Conditions::stop_line_active},
                            Case{&StopChoices::overrun_ramps, &Conditions::overrun},
                            Case{&StopChoices::terminate_ramps, &Conditions::terminate}}) {
        SupervisorConfig config;
        config.stops.terminate_ramps = false;
        config.stops.*one.choice = true;
        config.ramp_limit_cycles = 30;
        Supervisor s = driving(Mode::trajectory, config);
        Conditions c = in_motion();
        c.*one.what = true;
        CHECK(s.step(c).begins_braking);
        CHECK(s.mode() == Mode::fault);
        for (int i = 0; i < 30; ++i) {
            CHECK(s.ramping());
            CHECK(s.wants_armed());
            s.step(c, {false, Mode::idle});
        }
        s.step(c);
        CHECK_FALSE(s.ramping());  // the limit: coast
        CHECK_FALSE(s.wants_armed());
        CHECK(s.mode() == Mode::fault);
    }
}

// A stop goes to drives that are believed idle too; nothing else does.
TEST(SupervisorFaults, a_stop_disarms_whatever_the_state_and_only_a_stop) {
    Supervisor s({});
    for (int i = 0; i < 3; ++i) CHECK(s.step(healthy()).order == DriveOrder::none);
    Conditions c = healthy();
    c.stop_message = true;
    CHECK(s.step(c).order == DriveOrder::disarm);
    CHECK(s.mode() == Mode::fault);
    c.stop_message = false;
    CHECK(s.step(c).order == DriveOrder::none);
    for (const auto what : {&Conditions::stop_message, &Conditions::foreign_control}) {
        Conditions again = healthy();
        again.*what = true;
        CHECK(s.step(again).order == DriveOrder::disarm);
        CHECK(s.step(again).order == DriveOrder::disarm);
        CHECK(s.step(healthy()).order == DriveOrder::none);
    }
}

TEST(SupervisorFaults, clearing_in_idle_clears_the_drives_errors_and_nothing_else) {
    Supervisor s({});
    s.step(healthy());
    CHECK_FALSE(s.step(healthy(), {true, {}}).clear_drive_errors);
    Conditions c = healthy();
    c.drive_error = true;
    CHECK(s.step(c, {true, {}}).clear_drive_errors);
    CHECK(s.mode() == Mode::idle);
    CHECK_FALSE(s.step(c).clear_drive_errors);
}

TEST(SupervisorFaults, a_new_limit_of_the_ramp_is_in_force_at_once) {
    Supervisor s = driving(Mode::velocity);
    s.step(in_motion(), {false, Mode::idle});
    s.step(in_motion());
    CHECK(s.ramping());
    s.set_ramp_limit(5);
    for (int i = 0; i < 4; ++i) s.step(in_motion());
    CHECK_FALSE(s.ramping());
    CHECK(s.mode() == Mode::idle);
}

TEST(SupervisorEntry, a_mode_that_does_not_exist_is_refused) {
    for (const unsigned number : {unsigned(kModeCount), unsigned(kModeCount) + 1, 255U}) {
        Supervisor s({});
        CHECK(s.step(healthy(), {false, static_cast<Mode>(number)}).refused);
        CHECK(s.blocker() == Blocker::unknown_mode);
    }
}

TEST(SupervisorEntry, one_mode_learns_while_it_drives) {
    for (const ModeRule& rule : kModes) CHECK_EQUAL(rule.mode == Mode::adaptive, rule.learns);
}
