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
    DriveSight left{drivers::DriveState::armed, {}, {}, 0, 0};
    DriveSight right = left;
    Conditions told;
    bool wants_armed = true;
    bool braking = false;
    Judge judge_{parameters};

    Scene() { judge_.configure(); }

    Conditions judge() {
        seen.now_ns += kCycle_ns;
        if (feedback_comes) left.encoder_time_ns = right.encoder_time_ns = seen.now_ns;
        if (feedback_comes && believed) seen.encoder_taken_ns = {seen.now_ns, seen.now_ns};
        if (encoder_speed.step()) encoder_speed.look(encoder_rad, seen.encoder_taken_ns);
        seen.encoder_speed = &encoder_speed;
        return judge_.judge(
            {seen, left, right, parameters.geometry.wheel_radius_m, wants_armed, braking, 0, told});
    }
    bool feedback_comes = true, believed = true;
    control::EncoderSpeed encoder_speed;
    WheelPair<double> encoder_rad;
};

}  // namespace

TEST_GROUP(CycleSteps){};

TEST(CycleSteps, observe_follows_wheels_that_turn_evenly) {
    const model::RobotParameters parameters = model::default_parameters();
    const auto plant = control::plant_model<double>(parameters);
    Senses senses;
    senses.configure(parameters, 0);
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

// Behind a loop with such a lag, computed in periods T, a wheel that accelerates evenly is reported by
// lag (lag - 2 T) of that too far back, and by 2 lag - T / 2 of it too slow.
TEST(CycleSteps, observe_sees_angles_before_the_drives_loops_from_when_they_are_known) {
    model::RobotParameters parameters = model::default_parameters();
    parameters.drive.encoder_period_ms = 2;
    const WheelPair<double> rates{3, -8}, lags_s{0.012, 0.004};
    const auto plant = control::plant_model<double>(parameters);
    const double age_s = Senses::sample_age_s(parameters);
    constexpr double kLoop_s = 1.25e-4;
    const auto back_s2 = [](double lag_s) { return lag_s * (lag_s - 2 * kLoop_s); };
    for (const bool by_file : {false, true}) {
        Senses senses;
        parameters.drive.left.encoder_lag_s = by_file ? lags_s.left : 0;
        parameters.drive.right.encoder_lag_s = by_file ? lags_s.right : 0;
        senses.configure(parameters, kLoop_s);
        drivers::DriveFeedback left, right;
        const auto off_rad = [&](int i) {
            const double t_s = 1e-3 * i;
            const auto report = [&](drivers::DriveFeedback& f, double rate, double lag_s) {
                if (i % 2 != 0) return;
                f.encoder_time_ns = kCycle_ns * i;
                f.position_rad = rate * (t_s * t_s / 2 - back_s2(lag_s));
                f.speed_rad_per_s = rate * (t_s - (2 * lag_s - kLoop_s / 2));
            };
            report(left, rates.left, lags_s.left);
            report(right, rates.right, lags_s.right);
            const Observed seen =
                senses.observe({kCycle_ns * i, kCyclePeriod_s, true, left, right, nullptr, {}}, plant);
            const double then_s = t_s - age_s;
            if (!seen.angles_known) return WheelPair<double>{9, 9};
            const auto& encoder = *seen.encoder;
            const bool undone = by_file || i > 600;
            for (const std::size_t side : {0, 1}) {
                const double lag_s = side == 0 ? lags_s.left : lags_s.right;
                const double rate = side == 0 ? rates.left : rates.right;
                const drivers::DriveFeedback& f = side == 0 ? left : right;
                DOUBLES_EQUAL(f.position_rad, encoder[side].position_rad, 0);
                LONGS_EQUAL(f.encoder_time_ns - (undone ? 1'000'000 : 0), encoder[side].time_ns);
                if (i > 620 || i < 600)
                    DOUBLES_EQUAL(undone ? std::abs(rate) * back_s2(lag_s) / 30 : 0, encoder[side].unsure_rad,
                                  1e-9);
            }
            return WheelPair<double>{seen.sample.angle_rad.left - rates.left * then_s * then_s / 2,
                                     seen.sample.angle_rad.right - rates.right * then_s * then_s / 2};
        };
        WheelPair<double> off;
        for (int i = 1; i <= 600; ++i) off = off_rad(i);
        DOUBLES_EQUAL(by_file ? 0 : -rates.left * back_s2(lags_s.left), off.left, 1e-5);
        DOUBLES_EQUAL(by_file ? 0 : -rates.right * back_s2(lags_s.right), off.right, 1e-5);
        senses.set_encoder_lag(lags_s);
        int unknown = 0;
        for (int i = 601; i <= 640; ++i) {
            off = off_rad(i);
            unknown += off.left == 9;
        }
        CHECK(by_file ? unknown == 0 : unknown > 0 && unknown < 12);
        DOUBLES_EQUAL(0, off.left, 1e-5);
        DOUBLES_EQUAL(0, off.right, 1e-5);
    }
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
        {{DriveState::fault, DriveFault::error, {}, 0, 0}, &Conditions::drive_error},
        {{DriveState::fault, DriveFault::left_armed, {}, 0, 0}, &Conditions::drive_disarmed_itself},
        {{DriveState::silent, DriveFault::silent, {}, 0, 0}, &Conditions::drive_silent},
        {{DriveState::idle, {}, ArmRefusal::timed_out, 0, 0}, &Conditions::arming_refused},
        {{DriveState::armed, {}, {}, 0, 1}, &Conditions::foreign_control},
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
    scene.left.encoder_time_ns = scene.right.encoder_time_ns = scene.seen.now_ns;
    scene.seen.encoder_taken_ns = {scene.seen.now_ns, scene.seen.now_ns};
    const int limit =
        static_cast<int>(std::lround(scene.parameters.safety.stale_feedback_s / kCyclePeriod_s));
    for (int i = 0; i < limit; ++i) CHECK_FALSE(scene.judge().feedback_stale);
    CHECK(scene.judge().feedback_stale);
    scene.left.encoder_time_ns = scene.seen.now_ns;  // one wheel is not enough
    CHECK(scene.judge().feedback_stale);
    LONGS_EQUAL(3, scene.judge_.stale_feedback_cycles());
}

TEST(CycleSteps, judge_calls_frames_that_are_not_believed_stale_feedback) {
    for (const std::size_t side : {0U, 1U}) {
        Scene scene;
        CHECK_FALSE(scene.judge().feedback_stale);
        scene.believed = false;
        const int limit =
            static_cast<int>(std::lround(scene.parameters.safety.stale_feedback_s / kCyclePeriod_s));
        bool stale = false;
        for (int i = 0; i < limit; ++i) stale = scene.judge().feedback_stale;
        CHECK_FALSE(stale);
        for (int i = 0; i < 5; ++i) {  // as a drive's new origin is believed after four
            scene.seen.encoder_taken_ns[1 - side] = scene.seen.now_ns + kCycle_ns;
            stale = scene.judge().feedback_stale;
        }
        CHECK(stale);
    }
}

// The middle of the period before the last report: that old it may be just before the next one comes.
TEST(CycleSteps, samples_are_as_old_as_a_report_before_its_loop_may_be) {
    for (const int period_ms : {1, 2, 5, 10}) {
        Scene scene;
        scene.parameters.drive.encoder_period_ms = period_ms;
        const double age_ms = 1e3 * Senses::sample_age_s(scene.parameters);
        CHECK(age_ms >= 1.5 * period_ms + 0.5 - 1e-9);
        CHECK(age_ms <= 1.5 * period_ms + 1 + 1e-9);
    }
}

TEST(CycleSteps, judge_waits_four_encoder_periods_more_for_frames_that_are_not_believed) {
    for (const int period_ms : {2, 5}) {
        Scene scene;
        scene.parameters.drive.encoder_period_ms = period_ms;
        CHECK_FALSE(scene.judge().feedback_stale);
        scene.believed = false;
        const int limit =
            static_cast<int>(std::lround(scene.parameters.safety.stale_feedback_s / kCyclePeriod_s)) +
            4 * period_ms;
        for (int i = 1; i < limit; ++i) CHECK_FALSE(scene.judge().feedback_stale);
        scene.judge();  // at the limit itself the last digit decides
        CHECK(scene.judge().feedback_stale);
    }
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

// In numbers that are exact in binary.
TEST(CycleSteps, judge_calls_a_robot_at_the_very_speed_for_clearing_still) {
    for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
        Scene scene;
        scene.parameters.safety.clear_speed_m_per_s = 0.0625;
        scene.parameters.geometry.wheel_radius_m = {0.125, 0.125};
        scene.seen.last_torque_Nm.*side = 1;
        scene.seen.motion.wheel_speed_rad_per_s.*side = 0.5;
        CHECK_FALSE(scene.judge().moving);
        scene.seen.motion.wheel_speed_rad_per_s.*side = 0.5 + 1.0 / 1024;
        CHECK(scene.judge().moving);
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

TEST(CycleSteps, observe_tells_what_it_was_told_and_fuses_a_pose_from_outside) {
    model::RobotParameters parameters = model::default_parameters();
    parameters.adaptation.slip_yaw_rate_rad_per_s = 0.5;
    const auto plant = control::plant_model<double>(parameters);
    Senses senses;
    senses.configure(parameters, 0);
    drivers::DriveFeedback left, right;
    Observed seen;
    // The wheels stand; the world says that the robot is elsewhere, and later that it turns.
    const auto cycle = [&](int i, const Pose<double>* pose) {
        left.encoder_time_ns = right.encoder_time_ns = kCycle_ns * i;
        seen = senses.observe({kCycle_ns * i, kCyclePeriod_s, true, left, right, pose, {0.5, -0.25}}, plant);
        senses.torque_sent({0.5, -0.25});
    };
    const Pose<double> there{1, 0, 0.125};
    for (int i = 1; i < 2000; ++i) cycle(i, i % 50 == 0 ? &there : nullptr);
    LONGS_EQUAL(1999 * kCycle_ns, seen.now_ns);
    DOUBLES_EQUAL(kCyclePeriod_s, seen.elapsed_s, 0);
    DOUBLES_EQUAL(0.5, seen.last_torque_Nm.left, 0);
    DOUBLES_EQUAL(-0.25, seen.last_torque_Nm.right, 0);
    DOUBLES_EQUAL(-0.25, seen.sample.last_torque_Nm.right, 0);
    DOUBLES_EQUAL(1, seen.pose.x_m, 0.05);
    DOUBLES_EQUAL(seen.pose.heading_rad, seen.sample.heading_rad, 0);
    DOUBLES_EQUAL(seen.pose.heading_rad, seen.motion.heading_rad, 0);
    CHECK(std::abs(seen.sample.heading_rad) > 0.05);
    CHECK(seen.external_pose == nullptr);
    CHECK(seen.sample.usable);
    CHECK_FALSE(seen.slipping);
    for (int i = 2000; i < 3001; ++i) {  // 0.4 rad/s: less than the limit
        const Pose<double> turning{1, 0, 0.125 + 4e-4 * (i - 2000)};
        cycle(i, i % 50 == 0 ? &turning : nullptr);
        CHECK_FALSE(seen.slipping);
    }
    for (int i = 3001; i < 4001; ++i) {
        const Pose<double> turning{1, 0, 0.525 + 1e-3 * (i - 3000)};  // 1 rad/s
        cycle(i, i % 50 == 0 ? &turning : nullptr);
        if (i % 50 == 0) CHECK(seen.external_pose == &turning);
    }
    CHECK(seen.slipping);
    CHECK_FALSE(seen.sample.usable);
}

// With a model that expects 1e5 rad/s^2 of the torque, which does nothing.
TEST(CycleSteps, observe_tells_each_tenth_cycle_how_fast_the_wheels_turn_by_the_encoders_alone) {
    const model::RobotParameters parameters = model::default_parameters();
    auto plant = control::plant_model<double>(parameters);
    plant.dynamics.k7_per_kg_m = 1e4;
    Senses senses;
    senses.configure(parameters, 0);
    drivers::DriveFeedback left, right;
    double most_off_rad_per_s = 0;
    for (int i = 1; i <= 200; ++i) {
        left.encoder_time_ns = right.encoder_time_ns = kCycle_ns * i;
        left.position_rad = 2e-3 * i;
        right.position_rad = -3e-3 * i;
        senses.torque_sent({0.5 * (i % 7), 0.5 * (i % 7)});
        const Observed seen =
            senses.observe({kCycle_ns * i, kCyclePeriod_s, true, left, right, nullptr, {}}, plant);
        LONGS_EQUAL(i % 10 == 0, seen.encoder_speed != nullptr);
        if (i > 100)
            most_off_rad_per_s =
                std::max(most_off_rad_per_s, std::abs(seen.motion.wheel_speed_rad_per_s.left - 2));
        if (seen.encoder_speed == nullptr) continue;
        LONGS_EQUAL(i > 40, seen.encoder_speed->known());
        if (i <= 40) continue;
        DOUBLES_EQUAL(2, seen.encoder_speed->rad_per_s().left, 1e-9);
        DOUBLES_EQUAL(-3, seen.encoder_speed->rad_per_s().right, 1e-9);
    }
    CHECK(most_off_rad_per_s > 20);
}

// A loop of 100 rad/s is off by a ten thousandth of what accelerates the wheel; a count is root 12 of its
// noise.
TEST(CycleSteps, an_angle_behind_a_loop_that_has_more_than_a_count_to_go_is_unsure_by_one) {
    model::RobotParameters parameters = model::default_parameters();
    parameters.drive.left.encoder_lag_s = parameters.drive.right.encoder_lag_s = 0.01;
    parameters.velocity_loop.angle_noise_rad = 1e-3;
    const auto plant = control::plant_model<double>(parameters);
    Senses senses;
    senses.configure(parameters, 0);
    std::array<drivers::DriveFeedback, 2> drives;
    Observed seen;
    for (int i = 1; i <= 20; ++i) {
        for (const std::size_t each : {0, 1}) {
            drivers::DriveFeedback& drive = drives[each];
            const double gained = each == 0 ? 0.1 : 0.03;  // in a cycle
            drive.encoder_time_ns = kCycle_ns * i;
            drive.position_rad += 0.02 * gained + kCyclePeriod_s * (drive.speed_rad_per_s + gained / 2);
            drive.speed_rad_per_s += gained;
        }
        seen =
            senses.observe({kCycle_ns * i, kCyclePeriod_s, true, drives[0], drives[1], nullptr, {}}, plant);
    }
    DOUBLES_EQUAL(0.01 / 30 + std::sqrt(12.0) * 1e-3, (*seen.encoder)[0].unsure_rad, 1e-9);
    DOUBLES_EQUAL(0.003 / 30, (*seen.encoder)[1].unsure_rad, 1e-9);
}

TEST(CycleSteps, observe_tells_of_positions_and_speeds_that_are_of_two_scales) {
    model::RobotParameters parameters = model::default_parameters();
    const auto plant = control::plant_model<double>(parameters);
    for (const std::size_t wheel : {0, 1, 2}) {
        Senses senses;
        senses.configure(parameters, 0);
        std::array<drivers::DriveFeedback, 2> drives;
        Observed seen;
        for (int i = 1; i < 200; ++i) {
            for (const std::size_t each : {0, 1}) {
                drives[each].encoder_time_ns = kCycle_ns * i;
                drives[each].speed_rad_per_s = 4;
                drives[each].position_rad = (each == wheel ? 2 : 4) * kCyclePeriod_s * i;
            }
            seen = senses.observe({kCycle_ns * i, kCyclePeriod_s, true, drives[0], drives[1], nullptr, {}},
                                  plant);
            senses.look(drives[0], drives[1]);
        }
        CHECK_EQUAL(wheel < 2, seen.two_scales);
    }
}

// Half of the way, at an acceleration that only a known lag tells from it; and a speed that swings once in
// the time of a span, of which each report counts.
TEST(CycleSteps, look_compares_scales_by_each_drives_lag_and_by_every_report) {
    constexpr double kRate_rad_per_s2 = 60, kLag_s = 0.005;
    for (const std::size_t wheel : {0, 1}) {
        for (const bool known : {false, true}) {
            model::RobotParameters parameters = model::default_parameters();
            parameters.drive.left.encoder_lag_s = known && wheel == 0 ? kLag_s : 0;
            parameters.drive.right.encoder_lag_s = known && wheel == 1 ? kLag_s : 0;
            const auto plant = control::plant_model<double>(parameters);
            Senses senses;
            senses.configure(parameters, 1.0 / 8000);
            Senses swings;
            swings.configure(parameters, 1.0 / 8000);
            std::array<drivers::DriveFeedback, 2> drives, swinging;
            Observed seen, seen_swinging;
            for (int i = 1; i <= 150; ++i) {
                const double t_s = kCyclePeriod_s * i, angle = 2 * 3.14159265358979323846 * i / 5;
                for (const std::size_t each : {0, 1})
                    drives[each].encoder_time_ns = swinging[each].encoder_time_ns = kCycle_ns * i;
                drives[wheel].speed_rad_per_s = kRate_rad_per_s2 * t_s;
                drives[wheel].position_rad = kRate_rad_per_s2 * t_s * (t_s / 2 + 2 * kLag_s) / 2;
                swinging[wheel].speed_rad_per_s = 4 + 3.5 * std::cos(angle);
                swinging[wheel].position_rad = 4 * t_s + 3.5 * kCyclePeriod_s * std::sin(angle) / (angle / i);
                seen = senses.observe(
                    {kCycle_ns * i, kCyclePeriod_s, true, drives[0], drives[1], nullptr, {}}, plant);
                senses.look(drives[0], drives[1]);
                seen_swinging = swings.observe(
                    {kCycle_ns * i, kCyclePeriod_s, true, swinging[0], swinging[1], nullptr, {}}, plant);
                swings.look(swinging[0], swinging[1]);
                CHECK_FALSE(seen_swinging.two_scales);
            }
            CHECK_EQUAL(known, seen.two_scales);
        }
    }
}

TEST(CycleSteps, judge_adds_up_who_else_commands_the_drives) {
    Scene scene;
    Evidence evidence{scene.seen, scene.left, scene.right, scene.parameters.geometry.wheel_radius_m,
                      true,       false,      0,           scene.told};
    Judge judge(scene.parameters);
    CHECK_FALSE(judge.judge(evidence).foreign_control);
    scene.left.foreign_control = 1;
    CHECK(judge.judge(evidence).foreign_control);
    scene.right.foreign_control = 2;
    CHECK(judge.judge(evidence).foreign_control);
    evidence.strangers = 4;
    CHECK(judge.judge(evidence).foreign_control);
    CHECK_FALSE(judge.judge(evidence).foreign_control);
    LONGS_EQUAL(7, judge.foreign_control());
}

TEST(CycleSteps, judge_passes_on_why_a_drive_does_not_follow_or_arm) {
    for (DriveSight Scene::*side : {&Scene::left, &Scene::right}) {
        Scene scene;
        (scene.*side).fault = drivers::DriveFault::torque_not_followed;
        (scene.*side).state = drivers::DriveState::fault;
        CHECK(scene.judge().torque_not_followed);
        CHECK_FALSE(scene.judge().drive_error);
        scene.wants_armed = false;
        CHECK_FALSE(scene.judge().torque_not_followed);  // the drives shall not give any
        scene.wants_armed = true;
        scene.*side = {drivers::DriveState::idle, {}, drivers::ArmRefusal::none, 0, 0};
        CHECK_FALSE(scene.judge().torque_not_followed);
        CHECK(scene.judge().watchdog_confirmed);
        CHECK(scene.judge().control_mode_confirmed);
        (scene.*side).refusal = drivers::ArmRefusal::watchdog_not_confirmed;
        CHECK_FALSE(scene.judge().watchdog_confirmed);
        CHECK(scene.judge().control_mode_confirmed);
        (scene.*side).refusal = drivers::ArmRefusal::mode_not_confirmed;
        CHECK(scene.judge().watchdog_confirmed);
        CHECK_FALSE(scene.judge().control_mode_confirmed);
    }
}

TEST(CycleSteps, judge_allows_just_the_limits_of_speed_and_yaw_rate_either_way) {
    for (const double way : {1.0, -1.0}) {
        Scene scene;
        const auto& safety = scene.parameters.safety;
        scene.seen.motion.twist = {way * safety.over_speed_m_per_s, way * safety.over_yaw_rate_rad_per_s};
        CHECK_FALSE(scene.judge().over_speed);
        scene.seen.motion.twist = {1.001 * way * safety.over_speed_m_per_s, 0};
        CHECK(scene.judge().over_speed);
        scene.seen.motion.twist = {0, 1.001 * way * safety.over_yaw_rate_rad_per_s};
        CHECK(scene.judge().over_speed);
    }
}

TEST(CycleSteps, judge_believes_encoders_that_go_too_fast_where_the_observer_does_not) {
    for (const double way : {1.0, -1.0}) {
        for (const bool turns : {false, true}) {
            Scene scene;
            const auto& safety = scene.parameters.safety;
            const auto& radius_m = scene.parameters.geometry.wheel_radius_m;
            const double rim_m_per_s =
                way * (turns ? safety.over_yaw_rate_rad_per_s * scene.parameters.geometry.track_m / 2
                             : safety.over_speed_m_per_s);
            const auto goes_on = [&](double share, int cycles) {
                bool tripped = false;
                for (int i = 0; i < cycles; ++i) {
                    scene.encoder_rad.left +=
                        kCyclePeriod_s * share * (turns ? -rim_m_per_s : rim_m_per_s) / radius_m.left;
                    scene.encoder_rad.right += kCyclePeriod_s * share * rim_m_per_s / radius_m.right;
                    tripped = scene.judge().over_speed || tripped;
                }
                return tripped;
            };
            // a step of a coarse encoder more, over the span in which speed is looked at
            const double doubt = 1 + control::EncoderSpeed::kDoubt_rad_per_s *
                                         scene.parameters.geometry.mean_radius_m() / std::abs(rim_m_per_s);
            CHECK_FALSE(goes_on(0.98 * doubt, 1000));
            CHECK(goes_on(1.02 * doubt, 100));
            goes_on(0, 50);
            CHECK_FALSE(scene.judge().over_speed);
            scene.encoder_rad.left = kNaN;
            CHECK(goes_on(0, 10));
        }
    }
}

TEST(CycleSteps, judge_calls_moving_what_goes_on_and_not_what_trembles) {
    for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
        for (const double way : {1.0, -1.0}) {
            Scene scene;
            const double limit_rad_per_s = scene.parameters.safety.clear_speed_m_per_s /
                                           (scene.parameters.geometry.wheel_radius_m.*side);
            double& speed = scene.seen.motion.wheel_speed_rad_per_s.*side;
            const auto moving_after = [&](int cycles) {
                Conditions c;
                for (int i = 0; i < cycles; ++i) c = scene.judge();
                return c.moving;
            };
            for (int i = 0; i < 1000; ++i) {  // without a mean
                speed = (i % 2 == 0 ? 5 : -5) * limit_rad_per_s;
                CHECK_FALSE(scene.judge().moving);
            }
            speed = 0.9 * way * limit_rad_per_s;
            CHECK_FALSE(moving_after(1000));
            speed = 1.5 * way * limit_rad_per_s;
            CHECK(moving_after(100));
            speed = 0;
            CHECK(moving_after(10));  // 0.82 of it is left
            CHECK_FALSE(moving_after(90));
            speed = 1e6 * way;  // one wild value is not remembered for ever: known within a tenth of a second
            CHECK_FALSE(moving_after(1) && scene.seen.now_ns == 0);
            speed = 0;
            CHECK_FALSE(moving_after(100));
            speed = kNaN;
            CHECK(moving_after(1));
            speed = 0;
            CHECK_FALSE(moving_after(1));  // as soon as the speed is a number again
            // What a torque has begun is known at once, a tenth of a second long.
            scene.seen.last_torque_Nm.*side = 0.1 * way;
            CHECK_FALSE(moving_after(1));
            speed = 1.1 * way * limit_rad_per_s;
            CHECK(moving_after(1));
            scene.seen.last_torque_Nm = {};
            speed = 0;
            CHECK_FALSE(moving_after(98));
            speed = 1.1 * way * limit_rad_per_s;
            CHECK(moving_after(1));
            CHECK_FALSE(moving_after(1));
            speed = 0;
            CHECK_FALSE(moving_after(1000));
            speed = 1.5 * way * limit_rad_per_s;  // two thirds of it after 54.4 cycles of fifty's average
            CHECK_FALSE(moving_after(54));
            CHECK(moving_after(1));
        }
    }
}

TEST(CycleSteps, judge_says_that_a_robot_stands_at_a_tenth_of_the_speed_for_clearing) {
    for (double WheelPair<double>::*side : {&WheelPair<double>::left, &WheelPair<double>::right}) {
        for (const double share : {0.09, -0.09, 0.11, -0.11}) {
            Scene scene;
            scene.braking = true;
            const double radius_m = scene.parameters.geometry.wheel_radius_m.*side;
            scene.seen.motion.wheel_speed_rad_per_s.*side =
                share * scene.parameters.safety.clear_speed_m_per_s / radius_m;
            Conditions c;
            for (int i = 0; i < 30; ++i) c = scene.judge();
            CHECK_EQUAL(std::abs(share) > 0.1, c.rolling);
        }
    }
}

TEST(CycleSteps, judge_trusts_a_model_with_small_known_errors_of_all_that_is_in_it) {
    const auto trusted = [](double k7_error, double k8_error, auto change) {
        Scene scene;
        auto& p = scene.parameters;
        p.adaptation.trust_relative_error = 0.1;
        p.dynamics.k7_per_kg_m = 4;
        p.dynamics.k8_per_kg_m2 = 16;
        p.dynamics_standard_error.k7_per_kg_m = k7_error;
        p.dynamics_standard_error.k8_per_kg_m2 = k8_error;
        change(p);
        scene.judge_.configure();
        return scene.judge().model_trusted;
    };
    const auto as_is = [](model::RobotParameters&) {};
    CHECK(trusted(0.3, 1.5, as_is));
    CHECK(trusted(0.001, 0.001, as_is));
    CHECK(trusted(0.4, 1.6, as_is));      // just the limit
    CHECK_FALSE(trusted(0, 1.5, as_is));  // unknown
    CHECK_FALSE(trusted(0.3, 0, as_is));
    CHECK_FALSE(trusted(-0.3, 1.5, as_is));
    CHECK_FALSE(trusted(0.3, -1.5, as_is));
    CHECK_FALSE(trusted(0.5, 1.5, as_is));
    CHECK_FALSE(trusted(0.3, 1.7, as_is));
    // Amounts must all be measured, or stand without an error; a phase may be 0 where the rest is known.
    for (std::size_t effect = 0; effect < model::kEffectCount; ++effect) {
        const std::size_t count = model::kEffects[effect].parameters.size();
        const auto with = [&](std::size_t known, double value, double error) {
            return trusted(0.3, 1.5, [&](model::RobotParameters& p) {
                p.effects.active[effect] = true;
                for (std::size_t j = 0; j < count; ++j) {
                    p.effects.parameter[effect][j] = j < known ? value : 0;
                    p.effects_standard_error.parameter[effect][j] = j < known ? error : 0;
                }
            });
        };
        CHECK_FALSE(with(0, 0, 0));
        CHECK(with(count, 2, 0));
        CHECK(with(count, 0, 2));
        if (count > 1) CHECK_EQUAL(!model::kLinearInParameters[effect], with(count - 1, 2, 1));
    }
}

TEST(CycleSteps, a_host_is_gone_after_its_limit_unless_there_is_none) {
    HostLink host;
    CHECK(host_gone(host, kCycle_ns, 0.5));  // never heard
    CHECK_FALSE(host_gone(host, kCycle_ns, 0));
    hal::ReceivedFrame sign;
    sign.frame.id = protocol::HostAlive::id;
    sign.frame.length = protocol::HostAlive::length;
    sign.timestamp_ns = 1'000 * kCycle_ns;
    CHECK(protocol::encode_sealed(protocol::HostAlive{}, 1, sign.frame.data) == protocol::CodecStatus::ok);
    CHECK(host.accept(sign));
    CHECK_FALSE(host_gone(host, 1'400 * kCycle_ns, 0.5));
    CHECK(host_gone(host, 1'600 * kCycle_ns, 0.5));
    CHECK_FALSE(host_gone(host, 1'600 * kCycle_ns, 0));
}
