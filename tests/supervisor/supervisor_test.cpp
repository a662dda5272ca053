// The supervisor against what the issue of safety demands, stated here without its tables.
#include <array>
#include <cstdint>
#include <cstdio>
#include <random>

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

Supervisor started(SupervisorConfig config = {}) {
    Supervisor s(config);
    s.start();
    return s;
}

Supervisor driving(Mode mode, SupervisorConfig config = {}) {
    Supervisor s = started(config);
    CHECK(s.request(mode, healthy()) == Blocker::none);
    s.step(healthy());
    s.step(armed());
    CHECK(s.mode() == mode);
    CHECK(s.may_drive());
    return s;
}

struct Danger {
    const char* name;
    bool Conditions::*what;
    Fault fault;
};

// What must stop each driving mode, whatever else is true.
constexpr std::array kDangers{
    Danger{"feedback stale", &Conditions::feedback_stale, Fault::stale_feedback},
    Danger{"encoder implausible", &Conditions::encoder_implausible, Fault::encoder_implausible},
    Danger{"drive error", &Conditions::drive_error, Fault::drive_error},
    Danger{"drive silent", &Conditions::drive_silent, Fault::drive_silent},
    Danger{"drive left its armed state", &Conditions::drive_disarmed_itself, Fault::drive_left_armed_state},
    Danger{"over speed", &Conditions::over_speed, Fault::over_speed},
    Danger{"stop line", &Conditions::stop_line_active, Fault::emergency_stop_line},
    Danger{"stop message", &Conditions::stop_message, Fault::emergency_stop_message},
    Danger{"overrun", &Conditions::overrun, Fault::cycle_overrun},
    Danger{"torque not followed", &Conditions::torque_not_followed, Fault::torque_not_followed},
    Danger{"drive enable", &Conditions::drive_enable_failed, Fault::drive_enable_failed},
    Danger{"bus down", &Conditions::bus_down, Fault::bus_down},
    Danger{"not finite", &Conditions::not_finite, Fault::internal_error},
    Danger{"terminate", &Conditions::terminate, Fault::terminated},
};

}  // namespace

TEST_GROUP(SupervisorEntry){};

TEST(SupervisorEntry, permission_is_off_at_start) {
    Supervisor s({});
    CHECK(s.mode() == Mode::boot);
    CHECK_FALSE(s.may_drive());
    CHECK_FALSE(s.wants_armed());
    s.step(armed());
    CHECK(s.mode() == Mode::boot);
    s.start();
    s.step(armed());
    CHECK(s.mode() == Mode::idle);
    CHECK_FALSE(s.may_drive());
    CHECK_FALSE(s.wants_armed());
}

TEST(SupervisorEntry, nothing_may_be_asked_for_in_boot) {
    Supervisor s({});
    for (Mode mode : kDrivingModes) CHECK(s.request(mode, healthy()) == Blocker::not_idle);
    CHECK(s.mode() == Mode::boot);
}

TEST(SupervisorEntry, a_driving_mode_arms_first_and_drives_only_when_both_drives_follow) {
    for (Mode mode : kDrivingModes) {
        Supervisor s = started();
        CHECK(s.request(mode, healthy()) == Blocker::none);
        for (int i = 0; i < 50; ++i) {
            s.step(healthy());
            CHECK(s.mode() == Mode::idle);
            CHECK(s.phase() == Phase::arming);
            CHECK(s.wants_armed());
            CHECK_FALSE(s.may_drive());
        }
        s.step(armed());
        CHECK(s.mode() == mode);
        CHECK(s.may_drive());
        CHECK(s.entered());
        s.step(armed());
        CHECK_FALSE(s.entered());
    }
}

TEST(SupervisorEntry, entry_is_announced_once_also_between_driving_modes) {
    Supervisor s = driving(Mode::torque);
    s.step(armed());
    CHECK_FALSE(s.entered());
    CHECK(s.request(Mode::velocity, armed()) == Blocker::none);
    s.step(armed());
    CHECK(s.mode() == Mode::velocity);
    CHECK(s.entered());
    CHECK(s.may_drive());
    s.step(armed());
    CHECK_FALSE(s.entered());
}

TEST(SupervisorEntry, modes_that_cannot_be_asked_for_are_unknown) {
    Supervisor s = started();
    CHECK(s.request(Mode::boot, healthy()) == Blocker::unknown_mode);
    CHECK(s.request(Mode::fault, healthy()) == Blocker::unknown_mode);
    CHECK(s.request(static_cast<Mode>(kModeCount), healthy()) == Blocker::unknown_mode);
    CHECK(s.request(static_cast<Mode>(255), healthy()) == Blocker::unknown_mode);
    s.step(healthy());
    CHECK(s.mode() == Mode::idle);
    CHECK(s.phase() == Phase::steady);
}

TEST(SupervisorEntry, each_requirement_is_named_and_a_refusal_changes_nothing) {
    const auto refused = [](Mode mode, bool Conditions::*what, bool value, Blocker expected) {
        Supervisor s = started();
        Conditions c = healthy();
        c.*what = value;
        CHECK(s.request(mode, c) == expected);
        CHECK(s.blocker() == expected);
        s.step(c);
        CHECK(s.mode() == Mode::idle);
        CHECK_FALSE(s.wants_armed());
    };
    for (Mode mode : kDrivingModes) {
        refused(mode, &Conditions::stop_line_active, true, Blocker::stop_line_active);
        refused(mode, &Conditions::drive_silent, true, Blocker::drives_not_armed);
        refused(mode, &Conditions::drive_error, true, Blocker::drive_error);
    }
    refused(Mode::ident, &Conditions::moving, true, Blocker::robot_moving);
    for (Mode mode : {Mode::velocity, Mode::pose, Mode::trajectory, Mode::adaptive}) {
        refused(mode, &Conditions::velocity_design_accepted, false, Blocker::design_refused);
        refused(mode, &Conditions::model_known, false, Blocker::not_identified);
    }
    refused(Mode::adaptive, &Conditions::model_trusted, false, Blocker::model_not_trusted);
    // Torque and identification need neither a design nor a model.
    Conditions bare = healthy();
    bare.velocity_design_accepted = false;
    bare.model_known = false;
    bare.model_trusted = false;
    for (Mode mode : {Mode::torque, Mode::ident}) {
        Supervisor s = started();
        CHECK(s.request(mode, bare) == Blocker::none);
    }
}

TEST(SupervisorEntry, a_path_is_entered_when_its_pace_is_known) {
    for (Mode mode : kDrivingModes) {
        Supervisor s = started();
        Conditions c = armed();
        c.path_known = false;
        CHECK(s.request(mode, c) == Blocker::none);
        for (int i = 0; i < 10; ++i) s.step(c);
        CHECK_EQUAL(mode != Mode::trajectory && mode != Mode::adaptive, s.may_drive());
        c.path_known = true;
        s.step(c);
        CHECK(s.may_drive());
    }
}

TEST(SupervisorEntry, identification_starts_from_idle_only) {
    Supervisor s = driving(Mode::velocity);
    CHECK(s.request(Mode::ident, armed()) == Blocker::not_idle);
    s.step(armed());
    CHECK(s.mode() == Mode::velocity);
}

TEST(SupervisorEntry, arming_that_takes_too_long_or_is_refused_is_a_fault_that_says_why) {
    SupervisorConfig config;
    config.arming_limit_cycles = 20;
    Supervisor slow = started(config);
    slow.request(Mode::torque, healthy());
    for (int i = 0; i < 20; ++i) slow.step(healthy());
    CHECK(slow.phase() == Phase::arming);
    slow.step(healthy());
    CHECK(slow.fault() == Fault::arming_refused);
    CHECK(slow.blocker() == Blocker::drives_not_armed);

    Supervisor unguarded = started();
    Conditions c = healthy();
    c.watchdog_confirmed = false;
    unguarded.request(Mode::torque, c);
    c.arming_refused = true;
    unguarded.step(c);
    CHECK(unguarded.fault() == Fault::arming_refused);
    CHECK(unguarded.blocker() == Blocker::watchdog_not_confirmed);
    CHECK_FALSE(unguarded.wants_armed());

    Supervisor broken = started();
    c = healthy();
    broken.request(Mode::torque, c);
    c.arming_refused = c.drive_error = true;
    broken.step(c);
    CHECK(broken.fault() == Fault::arming_refused);
    CHECK(broken.blocker() == Blocker::drive_error);
}

TEST(SupervisorEntry, idle_from_motion_brakes_first) {
    Supervisor s = driving(Mode::velocity);
    Conditions c = armed();
    c.moving = c.rolling = true;
    CHECK(s.request(Mode::idle, c) == Blocker::none);
    for (int i = 0; i < 100; ++i) {
        s.step(c);
        CHECK(s.ramping());
        CHECK_FALSE(s.may_drive());
        CHECK(s.wants_armed());
    }
    c.moving = c.rolling = false;
    s.step(c);
    CHECK(s.mode() == Mode::idle);
    CHECK_FALSE(s.wants_armed());
}

TEST(SupervisorEntry, a_set_point_that_ends_while_braking_to_idle_is_no_fault) {
    Supervisor s = driving(Mode::velocity);
    Conditions c = armed();
    c.moving = c.rolling = true;
    s.request(Mode::idle, c);
    c.command_stale = true;
    s.step(c);
    CHECK(s.ramping());
    CHECK(s.fault() == Fault::none);
}

TEST(SupervisorEntry, a_finished_identification_returns_to_idle) {
    Supervisor s = driving(Mode::ident);
    Conditions c = armed();
    c.mode_finished = true;
    c.moving = c.rolling = true;
    s.step(c);
    CHECK(s.ramping());
    c.moving = c.rolling = false;
    s.step(c);
    CHECK(s.mode() == Mode::idle);
    CHECK(s.fault() == Fault::none);
}

TEST(SupervisorEntry, what_a_request_rested_on_is_looked_at_again_when_the_drives_are_armed) {
    for (Mode mode : kDrivingModes) {
        for (const auto what : {&Conditions::velocity_design_accepted, &Conditions::model_known,
                                &Conditions::model_trusted, &Conditions::moving}) {
            Supervisor s = started();
            CHECK(s.request(mode, healthy()) == Blocker::none);
            s.step(healthy());
            Conditions c = armed();
            c.*what = !(c.*what);
            const bool stands = started().request(mode, c) == Blocker::none;
            s.step(c);
            CHECK_EQUAL(stands, s.may_drive());
            CHECK_EQUAL(stands, s.wants_armed());
            CHECK_EQUAL(stands, s.blocker() == Blocker::none);
        }
    }
}

TEST_GROUP(SupervisorFaults){};

TEST(SupervisorFaults, an_emergency_stop_is_remembered_and_its_ramp_goes_on) {
    for (const bool ramps : {false, true}) {
        for (const auto what : {&Conditions::stop_message, &Conditions::stop_line_active}) {
            SupervisorConfig config;
            config.stops.emergency_stop_ramps = ramps;
            config.stops.stale_command_ramps = true;
            Supervisor s = driving(Mode::velocity, config);
            Conditions c = armed();
            c.rolling = c.moving = true;
            c.command_stale = true;
            s.step(c);
            CHECK(s.ramping());
            c.command_stale = false;
            c.*what = true;
            s.step(c);
            s.step(c);
            CHECK_EQUAL(ramps, s.ramping());
            CHECK(s.fault() == (what == &Conditions::stop_message ? Fault::emergency_stop_message
                                                                  : Fault::emergency_stop_line));
        }
    }
}

TEST(SupervisorFaults, each_danger_stops_each_driving_mode_in_the_cycle_that_sees_it_and_names_itself) {
    for (Mode mode : kDrivingModes) {
        for (const Danger& danger : kDangers) {
            SupervisorConfig config;
            config.stops.terminate_ramps = false;
            Supervisor s = driving(mode, config);
            Conditions c = armed();
            c.*danger.what = true;
            s.step(c);
            CHECK_TEXT(s.mode() == Mode::fault, danger.name);
            CHECK_TEXT(s.fault() == danger.fault, danger.name);
            CHECK_FALSE(s.may_drive());
            CHECK_FALSE(s.ramping());
            CHECK_FALSE(s.wants_armed());
        }
    }
}

TEST(SupervisorFaults, a_stale_set_point_or_a_host_that_is_gone_stops_every_mode) {
    for (Mode mode : kDrivingModes) {
        Supervisor s = driving(mode);
        Conditions c = armed();
        c.command_stale = true;
        s.step(c);
        CHECK(s.fault() == Fault::stale_command);
    }
}

TEST(SupervisorFaults, dangers_stop_arming_too_except_what_the_drives_answer_for) {
    for (const Danger& danger : kDangers) {
        Supervisor s = started();
        s.request(Mode::torque, healthy());
        s.step(healthy());
        Conditions c = healthy();
        c.*danger.what = true;
        s.step(c);
        // Their refusal ends the arming, and says why.
        const bool answered =
            danger.fault == Fault::drive_error || danger.fault == Fault::drive_left_armed_state;
        CHECK_TEXT((s.phase() == Phase::arming) == answered, danger.name);
        CHECK_FALSE(s.may_drive());
    }
}

TEST(SupervisorFaults, a_stop_message_is_latched_in_idle_as_well) {
    Supervisor s = started();
    Conditions c = healthy();
    c.stop_message = true;
    s.step(c);
    CHECK(s.fault() == Fault::emergency_stop_message);
}

TEST(SupervisorFaults, a_fault_stays_until_cleared_at_rest_with_its_cause_gone) {
    Supervisor s = driving(Mode::velocity);
    Conditions c = armed();
    c.stop_line_active = true;
    c.moving = c.rolling = true;
    s.step(c);
    c.stop_line_active = false;
    for (int i = 0; i < 1000; ++i) s.step(c);
    CHECK(s.mode() == Mode::fault);
    CHECK(s.clear_fault(c) == Blocker::robot_moving);
    c.moving = c.rolling = false;
    c.stop_line_active = true;
    CHECK(s.clear_fault(c) == Blocker::stop_line_active);
    c.stop_line_active = false;
    c.bus_down = true;
    CHECK(s.clear_fault(c) == Blocker::fault_latched);
    c.bus_down = false;
    c.terminate = true;
    CHECK(s.clear_fault(c) == Blocker::fault_latched);
    c.terminate = false;
    for (Mode mode : kDrivingModes) CHECK(s.request(mode, c) == Blocker::fault_latched);
    CHECK(s.clear_fault(c) == Blocker::none);
    s.step(c);
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
                            Case{&StopChoices::overrun_ramps, &Conditions::overrun},
                            Case{&StopChoices::terminate_ramps, &Conditions::terminate}}) {
        SupervisorConfig config;
        config.stops.terminate_ramps = false;
        config.stops.*one.choice = true;
        config.ramp_limit_cycles = 30;
        Supervisor s = driving(Mode::trajectory, config);
        Conditions c = armed();
        c.moving = c.rolling = true;
        c.*one.what = true;
        s.step(c);
        CHECK(s.mode() == Mode::fault);
        for (int i = 0; i < 30; ++i) {
            CHECK(s.ramping());
            CHECK(s.wants_armed());
            s.step(c);
        }
        s.step(c);
        CHECK_FALSE(s.ramping());  // the limit: coast
        CHECK_FALSE(s.wants_armed());
        CHECK(s.mode() == Mode::fault);
    }
}

TEST(SupervisorFaults, a_ramp_gives_way_to_whatever_makes_braking_unsafe) {
    for (const Danger& danger : kDangers) {
        if (danger.fault == Fault::over_speed || danger.fault == Fault::cycle_overrun ||
            danger.fault == Fault::terminated || danger.fault == Fault::drive_silent ||
            danger.fault == Fault::drive_left_armed_state) {
            continue;  // braking goes on, or shows as drives_armed == false below
        }
        SupervisorConfig config;
        config.stops.stale_command_ramps = true;
        Supervisor s = driving(Mode::velocity, config);
        Conditions c = armed();
        c.moving = c.rolling = true;
        c.command_stale = true;
        s.step(c);
        CHECK(s.ramping());
        c.*danger.what = true;
        s.step(c);
        CHECK_FALSE_TEXT(s.ramping(), danger.name);
    }
    SupervisorConfig config;
    config.stops.stale_command_ramps = true;
    Supervisor s = driving(Mode::velocity, config);
    Conditions c = armed();
    c.moving = c.rolling = true;
    c.command_stale = true;
    s.step(c);
    c.drives_armed = false;
    s.step(c);
    CHECK_FALSE(s.ramping());
}

TEST_GROUP(SupervisorRandomWalk){};

// Two million random cycles against four rules that need no knowledge of the tables.
TEST(SupervisorRandomWalk, whatever_happens_the_wheels_are_driven_only_with_permission) {
    std::mt19937_64 random(20260721);
    const auto chance = [&random](int one_in) { return random() % static_cast<std::uint64_t>(one_in) == 0; };
    SupervisorConfig config;
    config.arming_limit_cycles = 15;
    config.ramp_limit_cycles = 25;
    config.stops.stale_command_ramps = true;
    Supervisor s = started(config);
    bool permitted = false;  // a driving mode was asked for, and stood, since the last fault or idle
    long driven = 0;
    long faults = 0;
    for (long i = 0; i < 2'000'000; ++i) {
        Conditions c = healthy();
        c.drives_armed = s.wants_armed() && !chance(40);
        c.moving = c.rolling = chance(2);
        bool dangerous = false;
        for (const Danger& danger : kDangers) {
            if (chance(400)) {
                c.*danger.what = true;
                dangerous = true;
            }
        }
        c.command_stale = chance(500);
        const Mode before = s.mode();
        const Fault fault_before = s.fault();
        if (chance(30)) {
            const Mode wanted = static_cast<Mode>(random() % (kModeCount + 2));
            const Blocker answer = s.request(wanted, c);
            if (answer == Blocker::none) permitted = wanted != Mode::idle;
            if (answer != Blocker::none) CHECK(s.mode() == before);
        }
        bool cleared = false;
        if (chance(20)) cleared = s.clear_fault(c) == Blocker::none;
        s.step(c);
        if (s.may_drive()) {
            ++driven;
            CHECK(permitted);   // rule 1: only after a request that stood
            CHECK(!dangerous);  // rule 2: never in a cycle that sees a danger
        }
        if (s.mode() == Mode::fault) {
            permitted = false;
            ++faults;
            CHECK(s.fault() != Fault::none);
        }
        if (before == Mode::fault && !cleared) {
            CHECK(s.mode() == Mode::fault);  // rule 3: a fault stays until cleared,
            // and keeps its first name, unless an emergency stop comes
            if (c.stop_line_active) {
                CHECK(s.fault() == Fault::emergency_stop_line);
            } else if (c.stop_message) {
                CHECK(s.fault() == Fault::emergency_stop_message);
            } else {
                CHECK(s.fault() == fault_before);
            }
        }
        if (s.mode() == Mode::idle && s.phase() == Phase::steady) CHECK(!s.wants_armed());  // rule 4
    }
    std::printf("driven %ld cycles, in fault %ld of 2000000\n", driven, faults);
    CHECK(driven > 100'000);
    CHECK(faults > 100'000);
}
