// The steps of a cycle, each alone: values in, values out.
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/judge.hpp"
#include "firmware/task/motion_control.hpp"
#include "firmware/task/senses.hpp"
#include "firmware/task/setpoints.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::task;
using supervisor::Conditions;

namespace {

constexpr std::int64_t kCycle_ns = 1'000'000;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Evidence of a robot that rests, armed, with all well.
struct Scene {
    model::RobotParameters parameters = model::default_parameters();
    Observed seen;
    DriveSight left{drivers::DriveState::armed, {}, {}, 0};
    DriveSight right = left;
    Conditions told;
    bool wants_armed = true;
    bool braking = false;
    Judge judge_{parameters};

    Scene() { judge_.configure(); }

    Conditions judge() {
        seen.now_ns += kCycle_ns;
        if (feedback_comes) seen.trusted_ns = {seen.now_ns, seen.now_ns};
        return judge_.judge(
            {seen, left, right, parameters.geometry.wheel_radius_m, wants_armed, braking, 0, told});
    }
    bool feedback_comes = true;
};

}  // namespace

TEST_GROUP(CycleSteps){};

TEST(CycleSteps, observe_follows_wheels_that_turn_evenly) {
    const model::RobotParameters parameters = model::default_parameters();
    const auto plant = control::plant_model<double>(parameters);
    Senses senses;
    senses.configure(parameters);
    drivers::DriveFeedback left, right;
    const auto cycle = [&](int i, bool in_a_row) {
        left.encoder_time_ns = right.encoder_time_ns = kCycle_ns * i;
        left.position_rad = 2e-3 * i;
        right.position_rad = 3e-3 * i;
        return senses.observe({kCycle_ns * i, kCyclePeriod_s, in_a_row, left, right, nullptr, {}}, plant);
    };
    Observed seen;
    for (int i = 1; i < 3000; ++i) seen = cycle(i, true);
    DOUBLES_EQUAL(2, seen.motion.wheel_speed_rad_per_s.left, 1e-3);
    DOUBLES_EQUAL(3, seen.motion.wheel_speed_rad_per_s.right, 1e-3);
    const auto& r = parameters.geometry.wheel_radius_m;
    DOUBLES_EQUAL((r.left * 2 + r.right * 3) / 2, seen.motion.twist.v_m_per_s, 1e-3);
    CHECK(seen.pose.heading_rad > 0.1);
    // What the estimators take is as old as is told, and nothing where a cycle was missed.
    const double age_s = Senses::sample_age_s(parameters);
    CHECK(seen.angles_known);
    DOUBLES_EQUAL(2 * (2.999 - age_s), seen.sample.angle_rad.left, 1e-6);
    CHECK_FALSE(cycle(3000, false).sample.usable);
}

TEST(CycleSteps, judge_names_what_is_wrong_with_a_drive_on_either_side) {
    using drivers::ArmRefusal;
    using drivers::DriveFault;
    using drivers::DriveState;
    struct Case {
        DriveSight sight;
        bool Conditions::*what;
    };
    const Case cases[] = {
        {{DriveState::fault, DriveFault::error, {}, 0}, &Conditions::drive_error},
        {{DriveState::fault, DriveFault::left_armed, {}, 0}, &Conditions::drive_disarmed_itself},
        {{DriveState::silent, DriveFault::silent, {}, 0}, &Conditions::drive_silent},
        {{DriveState::idle, {}, ArmRefusal::timed_out, 0}, &Conditions::arming_refused},
        {{DriveState::armed, {}, {}, 1}, &Conditions::foreign_control},
    };
    for (const Case& one : cases) {
        for (DriveSight Scene::*side : {&Scene::left, &Scene::right}) {
            Scene scene;
            CHECK_FALSE(scene.judge().*one.what);
            scene.*side = one.sight;
            const Conditions c = scene.judge();
            for (const auto what :
                 {&Conditions::drive_error, &Conditions::drive_disarmed_itself, &Conditions::drive_silent,
                  &Conditions::arming_refused, &Conditions::foreign_control, &Conditions::feedback_stale}) {
                CHECK_EQUAL(what == one.what, c.*what);
            }
            CHECK_EQUAL(one.sight.state == DriveState::armed, c.drives_armed);
        }
    }
    // The foreigner counts in the cycle in which he was heard; a refusal only where arming is wanted.
    Scene scene;
    scene.right.foreign_control = 7;
    CHECK(scene.judge().foreign_control);
    CHECK_FALSE(scene.judge().foreign_control);
    scene.left.refusal = drivers::ArmRefusal::watchdog_not_confirmed;
    scene.wants_armed = false;
    CHECK_FALSE(scene.judge().arming_refused);
    CHECK_FALSE(scene.judge().watchdog_confirmed);
}

TEST(CycleSteps, judge_calls_feedback_stale_after_its_limit_and_before_the_first) {
    Scene scene;
    scene.feedback_comes = false;
    CHECK(scene.judge().feedback_stale);  // never came
    scene.seen.trusted_ns = {scene.seen.now_ns, scene.seen.now_ns};
    const int limit =
        static_cast<int>(std::lround(scene.parameters.safety.stale_feedback_s / kCyclePeriod_s));
    for (int i = 0; i < limit; ++i) CHECK_FALSE(scene.judge().feedback_stale);
    CHECK(scene.judge().feedback_stale);
    scene.seen.trusted_ns.left = scene.seen.now_ns;  // one wheel is not enough
    CHECK(scene.judge().feedback_stale);
    LONGS_EQUAL(3, scene.judge_.stale_feedback_cycles());
}

TEST(CycleSteps, judge_takes_what_is_no_number_for_danger) {
    for (const double bad : {kNaN, 1e9, -1e9}) {
        Scene scene;
        scene.seen.motion.twist.v_m_per_s = bad;
        CHECK(scene.judge().over_speed);
        Scene turning;
        turning.seen.motion.twist.omega_rad_per_s = bad;
        CHECK(turning.judge().over_speed);
        for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
            Scene rolling;
            rolling.braking = true;
            rolling.seen.motion.wheel_speed_rad_per_s.*side = bad;
            Conditions c;
            for (int i = 0; i < 100; ++i) c = rolling.judge();
            CHECK(c.moving);
            CHECK(c.rolling);
        }
    }
}

TEST(CycleSteps, judge_says_that_a_robot_stands_after_it_has_stood_while_braking) {
    Scene scene;
    for (int i = 0; i < 100; ++i) CHECK(scene.judge().rolling);  // nobody brakes
    scene.braking = true;
    for (int i = 1; i < 20; ++i) CHECK(scene.judge().rolling);
    CHECK_FALSE(scene.judge().rolling);
    scene.seen.motion.wheel_speed_rad_per_s.right = -1;
    CHECK(scene.judge().rolling);
}

TEST(CycleSteps, what_leaves_is_finite_and_within_the_limit) {
    for (const double bad : {kNaN, std::numeric_limits<double>::infinity()}) {
        for (const bool left : {true, false}) {
            MotionOutput wanted;
            wanted.torque_Nm = left ? WheelPair<double>{bad, 1} : WheelPair<double>{1, bad};
            const MotionOutput out = guarded(wanted, 5);
            CHECK_FALSE(out.finite);
            CHECK(out.torque_Nm.left == 0 && out.torque_Nm.right == 0);
        }
    }
    MotionOutput wanted;
    wanted.torque_Nm = {-7, 3};
    const MotionOutput out = guarded(wanted, 5);
    CHECK(out.finite);
    CHECK(out.torque_Nm.left == -5 && out.torque_Nm.right == 3);
}

TEST(CycleSteps, a_mode_is_what_its_row_says) {
    using supervisor::From;
    using supervisor::Law;
    using supervisor::ModeRule;
    using supervisor::Setpoint;
    const model::RobotParameters parameters = model::default_parameters();
    HostLink host;
    host.velocity.put({0.4, 0}, kCycle_ns);
    host.torque_Nm.put({2, -3}, kCycle_ns);
    Observed seen;
    seen.elapsed_s = kCyclePeriod_s;
    const auto reference = [&](const ModeRule& mode, WheelPair<double>& torque_Nm) {
        MotionControl control;
        control.configure(parameters);
        control.finish_design();
        control.enter(mode.law, seen);
        MotionOutput out;
        for (int i = 0; i < 100; ++i) out = control.torque(mode, seen, host);
        torque_Nm = out.torque_Nm;
        return out.reference.v_m_per_s;
    };
    WheelPair<double> torque_Nm;
    CHECK(reference(supervisor::rule_of(protocol::Mode::velocity), torque_Nm) > 0.01);
    CHECK(torque_Nm.left > 0);
    // The same law without a set-point stands still, whatever velocity comes.
    const ModeRule hold{protocol::Mode::velocity, From::idle, supervisor::kDrives, Law::velocity,
                        Setpoint::none,           false};
    CHECK(reference(hold, torque_Nm) == 0);
    CHECK(torque_Nm.left == 0 && torque_Nm.right == 0);
    reference(supervisor::rule_of(protocol::Mode::torque), torque_Nm);
    CHECK(torque_Nm.left == 2 && torque_Nm.right == -3);
    reference(supervisor::rule_of(protocol::Mode::ident), torque_Nm);
    CHECK(torque_Nm.left == 0 && torque_Nm.right == 0);
}

TEST(CycleSteps, a_set_point_is_late_after_so_many_of_its_own_cycle_times) {
    using supervisor::Setpoint;
    HostLink host;
    CHECK_FALSE(late(host, Setpoint::velocity, 1'000 * kCycle_ns, 3));  // has not begun to come
    host.velocity.put({}, kCycle_ns);
    host.goal.put({}, kCycle_ns);
    const std::int64_t limit_ns = 3 * protocol::VelocityCommand::cycle_time_ms * kCycle_ns;
    CHECK_FALSE(late(host, Setpoint::velocity, limit_ns, 3));
    CHECK(late(host, Setpoint::velocity, 2 * kCycle_ns + limit_ns, 3));
    CHECK_FALSE(late(host, Setpoint::goal, 2 * kCycle_ns + limit_ns, 3));  // has longer
    CHECK_FALSE(late(host, Setpoint::none, 2 * kCycle_ns + limit_ns, 3));
    forget_late(host, 2 * kCycle_ns + limit_ns, 3);
    CHECK_FALSE(host.velocity.received);
    CHECK(host.goal.received);
}
