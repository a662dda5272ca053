// What the probe is made of, each against a formula or a count; the whole of it drives in `wheelwright
// robots`.
#include <CppUTest/TestHarness.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <numeric>
#include <random>
#include <utility>

#include "firmware/ident/lifted_wheel.hpp"
#include "firmware/ident/parabola.hpp"
#include "firmware/ident/probe.hpp"
#include "firmware/ident/ramp_answer.hpp"
#include "firmware/ident/side_witness.hpp"
#include "firmware/ident/sizing.hpp"
#include "firmware/ident/speed_witness.hpp"
#include "firmware/ident/student.hpp"
#include "firmware/ident/torque_reports.hpp"

using namespace wheelwright;
using protocol::IdentCause;

TEST_GROUP(ProbeParts){};

TEST(ProbeParts, a_parabola_gives_its_acceleration_and_what_is_left) {
    ident::Parabola fit;
    for (int i = 0; i < 200; ++i) {
        const double t = 3.0 + 0.001 * i;
        fit.add(t, 700.0 - 2.5 * t + 0.5 * 8.0 * t * t + (i % 2 == 0 ? 1e-3 : -1e-3));
    }
    DOUBLES_EQUAL(8.0, fit.acceleration(), 0.05);
    DOUBLES_EQUAL(1e-3, std::sqrt(fit.residual_variance()), 2e-5);
    ident::Parabola few;
    for (int i = 0; i < 5; ++i) few.add(i, i * i);
    DOUBLES_EQUAL(0, few.acceleration(), 0);
    DOUBLES_EQUAL(0, few.residual_variance(), 0);
    ident::Parabola at_once;  // no time goes by
    for (int i = 0; i < 20; ++i) at_once.add(3, i);
    DOUBLES_EQUAL(0, at_once.acceleration(), 0);
    ident::Mean one;
    one.add(5);
    CHECK(one.error() > 1e100);
}

// Of the two-sided table of Student's t: 0.05, 0.01 and 0.001.
TEST(ProbeParts, an_error_of_few_is_never_too_small) {
    struct Row {
        double errors, freedom, t;
    };
    for (const auto& [errors, freedom, t] : {Row{1.960, 4, 2.776},
                                             {1.960, 10, 2.228},
                                             {1.960, 30, 2.042},
                                             {2.576, 4, 4.604},
                                             {2.576, 10, 3.169},
                                             {3.291, 4, 8.610},
                                             {3.291, 10, 4.587},
                                             {3.291, 30, 3.646}}) {
        const double of_few = errors * ident::error_of_few(errors, freedom);
        CHECK(of_few > 0.999 * t);
        CHECK(of_few < (freedom < 10 ? 1.08 : 1.01) * t);
    }
    CHECK(ident::error_of_few(4.0F, 1.0F) > 100);
}

TEST(ProbeParts, reports_tell_a_wrong_constant_from_clipping) {
    using Level = ident::TorqueReports::Level;
    const auto of = [](double ramp, double half, double whole) {
        ident::TorqueReports reports;
        for (int i = 0; i < 6; ++i) {
            reports.add(Level::ramp, ramp);
            reports.add(Level::half, half);
            reports.add(Level::whole, whole);
        }
        return reports;
    };
    DOUBLES_EQUAL(1, of(0.9, 0.9, 0.9).delivered_share(), 1e-12);  // Kt is wrong
    DOUBLES_EQUAL(0.9, of(0.9, 0.9, 0.9).ratio(), 1e-12);
    DOUBLES_EQUAL(0.6, of(1, 1, 0.6).delivered_share(), 1e-12);
    DOUBLES_EQUAL(0.3, of(0.7, 0.6, 0.3).delivered_share(), 1e-12);  // all of them are clipped
    DOUBLES_EQUAL(1, ident::TorqueReports{}.delivered_share(), 0);
}

namespace {

constexpr double kRadius_m = 0.09;
constexpr double kTrack_m = 0.47;

// Halts of a robot whose file has these mistakes, as its poses and its encoders show them: straight on, then
// turning, both as the file understands it.
IdentCause judged(double left_sign, double right_sign, bool swapped, bool poses, ident::SideWitness& witness,
                  double forward_m = 0.1, double turn_rad = 0.5) {
    witness.start({{kRadius_m, kRadius_m}, kTrack_m}, 0.002, 0.004);
    Pose<double> pose{1, 2, 3};
    WheelPair<double> angle{4, 5};
    const auto halt = [&](std::size_t at) {
        for (int i = 0; poses && i < 5; ++i) witness.add(pose);
        witness.halt(at, angle);
    };
    const auto move = [&](double left_rad, double right_rad) {
        angle = {angle.left + left_rad, angle.right + right_rad};
        double left = left_sign * left_rad;
        double right = right_sign * right_rad;
        if (swapped) std::swap(left, right);
        const Twist<double> way = model::twist_from_wheel_speeds(
            model::Geometry<double>{{kRadius_m, kRadius_m}, kTrack_m}, WheelPair<double>{left, right});
        pose = model::advance_along_arc(pose, way.v_m_per_s, way.omega_rad_per_s);
    };
    halt(0);
    move(forward_m / kRadius_m, forward_m / kRadius_m);
    halt(1);
    const double rim_m = turn_rad * kTrack_m / 2;
    move(-rim_m / kRadius_m, rim_m / kRadius_m);
    halt(2);
    return witness.judge();
}

}  // namespace

TEST(ProbeParts, poses_name_what_the_wheels_cannot_tell) {
    ident::SideWitness witness;
    CHECK(judged(1, 1, false, true, witness) == IdentCause::none);
    CHECK(witness.confirmed());
    CHECK(judged(-1, 1, false, true, witness) == IdentCause::left_sign_wrong);
    CHECK(judged(1, -1, false, true, witness) == IdentCause::right_sign_wrong);
    CHECK(judged(-1, -1, false, true, witness) == IdentCause::both_signs_wrong);
    CHECK(judged(1, 1, true, true, witness) == IdentCause::wheels_swapped);
    CHECK(judged(1, 1, true, false, witness) == IdentCause::none);
    CHECK_FALSE(witness.confirmed());
}

// Where its rim has gone as far as its encoder says, by poses, a wheel is no wheel in the air.
TEST(ProbeParts, poses_tell_a_wheel_that_rolls_from_one_that_turns_in_the_air) {
    ident::SideWitness witness;
    const auto rolls = [&](double left_share, double right_share, bool poses, double forward_m = 0.1,
                           double turn_rad = 0.5) {
        judged(left_share, right_share, false, poses, witness, forward_m, turn_rad);
        return std::pair{witness.rolls(0), witness.rolls(1)};
    };
    CHECK(rolls(1, 1, true) == std::pair(true, true));
    CHECK(rolls(1.05, 0.95, true) == std::pair(true, true));  // the file's radii are not quite right
    CHECK(rolls(1 / 1.55, 1, true) == std::pair(false, true));
    CHECK(rolls(1, 1 / 1.55, true) == std::pair(true, false));
    CHECK(rolls(1, 0, true) == std::pair(true, false));
    CHECK(rolls(1, -1, true) == std::pair(true, false));
    CHECK(rolls(1, 1, false) == std::pair(false, false));
    // ways that are lost in the poses' noise
    CHECK(rolls(1, 1, true, 0.005) == std::pair(false, false));
    CHECK(rolls(1, 1, true, 0.1, 0.02) == std::pair(false, false));
}

// The way back of what is exchanged tells twice as much as the way that is missing where a sign is wrong.
TEST(ProbeParts, a_short_way_still_names_wheels_that_are_swapped) {
    ident::SideWitness witness;
    CHECK(judged(1, 1, true, true, witness, 0.011, 0.1) == IdentCause::wheels_swapped);
    CHECK(judged(-1, -1, false, true, witness, 0.011, 0.1) == IdentCause::both_signs_wrong);
    CHECK(judged(1, 1, false, true, witness, 0.011, 0.1) == IdentCause::none);
    CHECK(witness.confirmed());
    // that turn says nothing
    CHECK(judged(1, 1, true, true, witness, 0.011, 0.004) == IdentCause::none);
    CHECK_FALSE(witness.confirmed());
}

TEST(ProbeParts, a_lifted_wheel_is_told_from_a_weak_drive_and_from_wheels_that_do_nothing_to_each_other) {
    const auto judged = [](const ident::WheelAnswers& answers, double error, bool friction_cancels = true) {
        return ident::wheel_off_ground(answers, error, 0.03, friction_cancels);
    };
    // rotors of 0.6 and of 0.05 of what the torque moves
    CHECK(judged({{1.67, 1}, {0, 0}}, 0.01) == IdentCause::left_wheel_off_ground);
    CHECK(judged({{1, 20}, {0.02, 0}}, 0.01) == IdentCause::right_wheel_off_ground);
    // drives that give 0.7 and 0.5 of what they should
    CHECK(judged({{1, 0.7}, {0, 0}}, 0.01) == IdentCause::none);
    CHECK(judged({{1, 0.5}, {-0.3, -0.15}}, 0.01) == IdentCause::none);
    CHECK(judged({{1, 1}, {0, 0}}, 0.01) == IdentCause::none);
    // noise, and pushes so gentle that friction takes its part
    CHECK(judged({{1.67, 1}, {0, 0}}, 0.3) == IdentCause::none);
    CHECK(judged({{2.4, 1}, {0, 0}}, 0.01, false) == IdentCause::none);
}

// By Newton-Euler: the masses M that the rims feel, and their answers, the inverse of it.
TEST(ProbeParts, a_centre_of_gravity_beside_the_middle_is_no_lifted_wheel) {
    const auto judged = [](double rotors, double left_in_tracks, double inertia, double right_gain) {
        const double body = 1 - rotors;  // of the effective mass
        const double l = 2 * left_in_tracks;
        const double yaw =
            body * (inertia + l * l);  // about the middle, of mass times half the track squared
        const double mll = (body + 2 * body * l + yaw) / 4 + rotors / 2;
        const double mrr = (body - 2 * body * l + yaw) / 4 + rotors / 2;
        const double mlr = (body - yaw) / 4;
        const double det = mll * mrr - mlr * mlr;
        const ident::WheelAnswers answers{{mrr / det, right_gain * mll / det},
                                          {-right_gain * mlr / det, -mlr / det}};
        const double own = std::max(answers.own.left, answers.own.right);
        return ident::wheel_off_ground(answers, 0.005 * own, ident::kPushedApart * own);
    };
    int weak = 0, called = 0;
    for (const double rotors : {0.02, 0.2, 0.6})
        for (int left = -10; left <= 10; ++left)  // hundredths of the track
            for (int inertia = 50; inertia <= 200; ++inertia) {
                CHECK(judged(rotors, 0.01 * left, 0.01 * inertia, 1) == IdentCause::none);
                // and a weak drive beside it: chance may make it look so
                ++weak;
                if (judged(rotors, 0.01 * left, 0.01 * inertia, 0.8) != IdentCause::none) ++called;
            }
    CHECK(called < 0.01 * weak);
    // a drawn robot, 0.1 of the track beside the middle and more: what its wheels do to each other is little,
    // and more than friction leaves
    const double error = 0.0043;
    CHECK(ident::wheel_off_ground({{1, 0.576}, {0.0065, 0.0009}}, error,
                                  std::max(error, ident::kPushedApart)) == IdentCause::none);
}

// A weak drive beside a centre of gravity beside the middle, on a robot whose wheels do nothing to each
// other: `wheelwright robots --seed 857227502 --only 53`, as its pushes saw it.
namespace {

// Pushed as the probe does, twice in each direction straight on and turning. `left`, `right`: signs by which
// the file is wrong.
struct Pushed {
    double k5_m = 0.25, left = 1, right = 1;
    double weak_right = 1;        // of the speed that the push gives the left wheel
    bool left_in_air = false;     // and the right one alone with its friction
    double scrub_m_per_s2 = 0.2;  // slows every turn
    double scrub_back = 1;        // and turns to the right by this much of it
    double slope_m_per_s2 = 0;
    double spread = 1e-4;  // of the pushes' means
    int rounds = 2;
    int straight_rounds = 8;    // of them at most
    double end_m_per_s = 0.25;  // of a push; the square of the speed is a third of that's
    int seed = 5;

    ident::SpeedWitness witness() const {
        constexpr double h = kTrack_m / 2, k7 = 0.4, k8 = 1.9;
        const double k6_per_m = -k5_m * k8 / (h * k7);
        constexpr std::array<std::array<double, 2>, 2> kFriction{
            {{0.30, 0.36}, {0.41, 0.33}}};  // back, forward
        ident::SpeedWitness seen;
        std::mt19937 random(static_cast<unsigned>(seed));
        std::normal_distribution<double> noise(0, spread);
        for (int push = 0; push < 2 * rounds; ++push)
            for (const bool turning : {false, true}) {
                if (!turning && push >= 2 * straight_rounds) continue;
                const bool forward = push % 2 == 0;
                const double sense = forward ? 1 : -1;
                const WheelPair<double> by_file{sense * (turning ? -1 : 1), sense * weak_right};
                const WheelPair<double> rim{left * by_file.left, right * by_file.right};
                const double v = (rim.left + rim.right) / 2, omega = (rim.right - rim.left) / (2 * h);
                const double square = end_m_per_s * end_m_per_s / 3;
                const double scrub = omega > 0 ? scrub_m_per_s2 : scrub_back * scrub_m_per_s2;
                const double dv = k5_m * omega * omega * square + slope_m_per_s2;
                const double turn = h * k6_per_m * v * omega * square -
                                    (std::abs(omega * h) > 0.5 ? std::copysign(scrub, omega) : 0);
                const auto slowed = [&](int wheel, double by_file_m_per_s) {
                    const double friction = kFriction[wheel][by_file_m_per_s > 0];
                    return -std::copysign(friction, by_file_m_per_s) + noise(random);
                };
                seen.add(turning, forward,
                         {slowed(0, by_file.left) + (left_in_air ? 0 : left * (dv - turn)),
                          slowed(1, by_file.right) + (left_in_air ? 0 : right * (dv + turn))});
            }
        return seen;
    }
};

}  // namespace

TEST(ProbeParts, what_speed_does_tells_the_floor_and_one_wrong_sign) {
    using ident::Mirror;
    for (const double k5_m : {0.25, -0.25})
        for (const double weak : {1.0, 0.6, 1.5}) {
            Pushed robot{.k5_m = k5_m, .weak_right = weak};
            const ident::SpeedWitness filed = robot.witness();
            CHECK(filed.judge_mirror() == Mirror::as_filed);
            CHECK(filed.on_floor(0) && filed.on_floor(1));
            robot.slope_m_per_s2 = 0.3;
            CHECK(robot.witness().judge_mirror() == Mirror::as_filed);
            robot.slope_m_per_s2 = 0;
            for (const double left : {1.0, -1.0}) {
                robot.left = left;
                robot.right = -left;
                CHECK(robot.witness().judge_mirror() == Mirror::mirrored);
            }
        }
    const Pushed above_the_axle{.k5_m = 0};  // friction of each wheel and direction, 0.3 to 0.41 m/s^2
    DOUBLES_EQUAL(0.35, above_the_axle.witness().friction_m_per_s2(), 0.001);
}

TEST(ProbeParts, friction_scrub_and_a_wheel_in_the_air_are_not_taken_for_what_speed_does) {
    using ident::Mirror;
    const ident::SpeedWitness lifted = Pushed{.left_in_air = true}.witness();
    CHECK_FALSE(lifted.on_floor(0));
    CHECK(lifted.judge_mirror() == Mirror::unknown);
    CHECK(Pushed{.k5_m = 0}.witness().judge_mirror() == Mirror::unknown);
    // what shows at one wheel only tells that this one is on the floor, and not which way it goes; a small
    // share of what slows it tells nothing
    for (const double pulled_m_per_s2 : {0.1, 0.01}) {
        ident::SpeedWitness one_wheel = Pushed{.k5_m = 0}.witness();
        for (const bool forward : {false, true})
            for (int push = 0; push < 200; ++push)
                one_wheel.add(true, forward,
                              {pulled_m_per_s2 + (forward ? 0.30 : -0.36), forward ? -0.33 : 0.41});
        CHECK_EQUAL(pulled_m_per_s2 > 0.05, one_wheel.on_floor(0));
        CHECK_FALSE(one_wheel.on_floor(1));
        CHECK(one_wheel.judge_mirror() == Mirror::unknown);
    }
    // a tenth less of it one way round looks like a wrong sign that matters little
    const Pushed unlike_scrub{.k5_m = 0, .scrub_back = 0.9};
    CHECK(unlike_scrub.witness().judge_mirror() == Mirror::unknown);
    // lost in noise; seen once each way, which has no standard error; not pushed at all
    const ident::SpeedWitness noisy = Pushed{.spread = 0.05}.witness();
    CHECK(noisy.judge_mirror() == Mirror::unknown);
    CHECK_FALSE(noisy.on_floor(0) || noisy.on_floor(1));
    const ident::SpeedWitness once = Pushed{.rounds = 1}.witness();
    CHECK(once.judge_mirror() == Mirror::unknown);
    CHECK_FALSE(once.on_floor(0) || once.on_floor(1));
    CHECK(ident::SpeedWitness{}.judge_mirror() == Mirror::unknown);
    DOUBLES_EQUAL(0, ident::SpeedWitness{}.friction_m_per_s2(), 0);
}

// What hides in scrub that is unlike, each way round, does not grow with speed; what speed does, does.
TEST(ProbeParts, brisk_pushes_tell_one_wrong_sign_from_unlike_scrub) {
    using ident::Mirror;
    const auto pushed = [](double k5_m, double end_m_per_s, double spread, double scrub_m_per_s2,
                           double scrub_back) {
        return Pushed{.k5_m = k5_m,
                      .left = -1,
                      .scrub_m_per_s2 = scrub_m_per_s2,
                      .scrub_back = scrub_back,
                      .spread = spread,
                      .end_m_per_s = end_m_per_s}
            .witness();
    };
    for (const double k5_m : {0.003, -0.003, 0.0}) {
        const Mirror told = k5_m == 0 ? Mirror::unknown : Mirror::mirrored;
        const ident::SpeedWitness slow = pushed(k5_m, 0.25, 1e-4, 0.2, 0.9);
        const ident::SpeedWitness brisk = pushed(k5_m, 0.75, 1e-4, 0.2, 0.9);
        CHECK(slow.judge_mirror() == Mirror::unknown);
        CHECK(brisk.judge_mirror() == Mirror::unknown);
        CHECK(brisk.judge_mirror(slow) == told);
        // not where noise hides the slower ones, nor where either is not there
        const ident::SpeedWitness noisy = pushed(k5_m, 0.25, 0.02, 0.2, 0.9);
        CHECK(brisk.judge_mirror(noisy) == Mirror::unknown);
        CHECK(brisk.judge_mirror({}) == Mirror::unknown);
        CHECK(ident::SpeedWitness{}.judge_mirror(slow) == Mirror::unknown);
        CHECK(pushed(k5_m, 0.9, 1e-4, 0.2, 1).judge_mirror(noisy) == told);  // brisk ones alone show it
    }
    // a scrub that grows with speed, unlike by a fiftieth
    CHECK(pushed(0, 0.75, 1e-4, 0.6, 1.02).judge_mirror(pushed(0, 0.25, 1e-4, 0.2, 1)) == Mirror::unknown);
    Pushed as_filed{.k5_m = 0.003, .spread = 0.0002};
    const ident::SpeedWitness slow = as_filed.witness();
    as_filed.end_m_per_s = 0.75;
    CHECK(as_filed.witness().judge_mirror(slow) == Mirror::as_filed);
}

// Of noise the more pushes there are the less is taken for more than it is.
TEST(ProbeParts, four_pushes_in_each_direction_need_not_stand_out_as_far_as_two) {
    using ident::Mirror;
    int told_by_two = 0, told_by_four = 0, wrong = 0;
    for (int seed = 0; seed < 4000; ++seed) {
        const auto judged = [&](double k5_m, int rounds) {
            const Pushed robot{.k5_m = k5_m,
                               .left = -1,
                               .scrub_m_per_s2 = 0,
                               .spread = 0.01,
                               .rounds = rounds,
                               .seed = seed};
            return robot.witness().judge_mirror();
        };
        told_by_two += judged(0.12, 2) == Mirror::mirrored ? 1 : 0;
        told_by_four += judged(0.12, 4) == Mirror::mirrored ? 1 : 0;
    }
    // Of noise alone, pushed straight on twice each way, as the probe does.
    constexpr int kNoises = 200'000;
    for (int seed = 0; seed < kNoises; ++seed) {
        const Pushed robot{
            .k5_m = 0, .scrub_m_per_s2 = 0, .spread = 0.01, .rounds = 4, .straight_rounds = 2, .seed = seed};
        wrong += robot.witness().judge_mirror() != Mirror::unknown ? 1 : 0;
    }
    std::printf("  of 4000: %d by two, %d by four; of %d without anything: %d\n", told_by_two, told_by_four,
                kNoises, wrong);
    CHECK(told_by_four > 2 * told_by_two);
    CHECK(wrong <= 8);  // twice in 10^5, and chance
    // Slower ones and brisker ones together, where a scrub that is unlike hides what either shows.
    constexpr int kNoisesEach = kNoises / 2;
    constexpr double kSpread = 0.001;
    int told_by_each = 0, wrong_by_each = 0;
    for (int seed = 0; seed < kNoisesEach; ++seed) {
        const auto judged = [&](double k5_m) {
            Pushed robot{.k5_m = k5_m,
                         .left = -1,
                         .scrub_back = 0.9,
                         .spread = kSpread,
                         .rounds = 4,
                         .straight_rounds = 2,
                         .end_m_per_s = 0.2,
                         .seed = seed};
            const ident::SpeedWitness slow = robot.witness();
            robot.end_m_per_s = 0.5;
            robot.seed += kNoises;
            return robot.witness().judge_mirror(slow);
        };
        wrong_by_each += judged(0) != Mirror::unknown ? 1 : 0;
        if (seed < 4000) told_by_each += judged(0.0036) == Mirror::mirrored ? 1 : 0;
    }
    std::printf("  by slow and brisk: %d of 4000; of %d without anything: %d\n", told_by_each, kNoisesEach,
                wrong_by_each);
    CHECK(told_by_each > 2800);  // half of them, if it took the errors of one witness
    CHECK(wrong_by_each <= 5);
}

namespace {

ident::SizingRequest request() {
    ident::SizingRequest r;
    r.track_m = kTrack_m;
    r.radius_m = kRadius_m;
    r.sample_time_s = 0.001;
    r.distance_limit_m = 1.5;
    r.torque_limit_Nm = 8;
    r.robot_speed_limit_m_per_s = 1.4;
    r.robot_yaw_rate_limit_rad_per_s = 4;
    return r;
}

ident::ProbeFindings found() {
    ident::ProbeFindings f;
    f.angle_noise_rad = 3e-4;
    f.friction_Nm = 0.5;
    f.k7_per_kg_m = 0.4;
    f.k8_per_kg_m2 = 1.7;
    f.torque_limit_Nm = 8;
    return f;
}

}  // namespace

TEST(ProbeParts, what_is_given_is_obeyed_and_the_rest_follows) {
    ident::SizingRequest r = request();
    const ident::Sizing free = ident::size_identification(r, found());
    CHECK(free.obstacle == IdentCause::none);
    DOUBLES_EQUAL(8, free.amplitude_Nm, 0);
    CHECK(free.speed_limit_m_per_s <= r.robot_speed_limit_m_per_s);
    // rows and bits must drift through each other
    LONGS_EQUAL(1,
                std::gcd(std::lround(2 * free.kernel_s / 3 / 0.001), std::lround(free.bit_time_s / 0.001)));
    r.amplitude_Nm = 3;
    r.bit_time_s = 0.033;
    r.kernel_s = 0.06;
    r.speed_limit_m_per_s = 0.31;
    r.yaw_rate_limit_rad_per_s = 0.9;
    r.coupling_standard_error_m = 0.004;
    const ident::Sizing given = ident::size_identification(r, found());
    DOUBLES_EQUAL(3, given.amplitude_Nm, 0);
    DOUBLES_EQUAL(0.033, given.bit_time_s, 0);
    DOUBLES_EQUAL(0.06, given.kernel_s, 0);
    DOUBLES_EQUAL(0.31, given.speed_limit_m_per_s, 0);
    DOUBLES_EQUAL(0.9, given.yaw_rate_limit_rad_per_s, 0);
    DOUBLES_EQUAL(0.004, given.coupling_standard_error_m, 0);
}

TEST(ProbeParts, a_bit_holds_three_reports_of_the_encoders_and_lags_of_their_loops) {
    ident::SizingRequest r = request();
    const ident::Sizing each_cycle = ident::size_identification(r, found());
    for (const double period_s : {0.001, 0.002}) {
        r.report_period_s = period_s;
        DOUBLES_EQUAL(each_cycle.bit_time_s, ident::size_identification(r, found()).bit_time_s, 0);
    }
    r.report_period_s = 0.02;
    const ident::Sizing seldom = ident::size_identification(r, found());
    DOUBLES_EQUAL(0.06, seldom.bit_time_s, 1e-12);
    ident::ProbeFindings slow = found();
    slow.encoder_lag_s = 0.02;
    DOUBLES_EQUAL(0.06, ident::size_identification(request(), slow).bit_time_s, 1e-12);
    CHECK(each_cycle.bit_time_s < 0.06);
    CHECK(seldom.amplitude_Nm <= each_cycle.amplitude_Nm);
}

// A wheel that turns round is seen to do so as late as the reports come, however fine its encoder is.
TEST(ProbeParts, a_wheel_may_stand_for_as_long_as_reports_hide_it) {
    const ident::SpeedSpan noisy = ident::speed_span(4e-3, 20, 0.001, 0.001);
    const ident::SpeedSpan fine = ident::speed_span(4e-6, 20, 0.001, 0.001);
    const ident::SpeedSpan fine_and_seldom = ident::speed_span(4e-6, 20, 0.001, 0.01);
    CHECK(fine.standing_speed_rad_per_s < 0.1 * noisy.standing_speed_rad_per_s);
    CHECK(fine_and_seldom.standing_samples >= 10);
    CHECK(fine_and_seldom.standing_samples < 20);
    CHECK(fine_and_seldom.standing_speed_rad_per_s > 20 * 0.01);
    DOUBLES_EQUAL(noisy.standing_speed_rad_per_s,
                  ident::speed_span(4e-3, 20, 0.001, 0.005).standing_speed_rad_per_s, 0);
}

// A quantised angle has a twelfth root of its step as noise (Widrow), and none at rest; white noise hides no
// step.
TEST(ProbeParts, a_coarse_encoder_hides_its_step) {
    constexpr double kStep_rad = 4e-3;
    for (const double kept : {0.5, 1.0})  // by a drive's own loop
        CHECK(ident::hidden_by_noise_rad(kept * kStep_rad / std::sqrt(12), 0) > kStep_rad);
    DOUBLES_EQUAL(3 * std::sqrt(2) * 2e-4, ident::hidden_by_noise_rad(2e-4, 2e-4), 1e-12);
    DOUBLES_EQUAL(3 * std::sqrt(2) * 2e-4, ident::hidden_by_noise_rad(2e-4, 3e-4), 1e-12);
}

TEST(ProbeParts, a_robot_that_cannot_be_identified_has_its_obstacle) {
    ident::ProbeFindings heavy = found();
    heavy.friction_Nm = 6;
    CHECK(ident::size_identification(request(), heavy).obstacle == IdentCause::too_heavy);
    ident::ProbeFindings clipped = found();
    clipped.clipped = clipped.clipped_by_report = true;
    clipped.torque_limit_Nm = 0.6;
    CHECK(ident::size_identification(request(), clipped).obstacle == IdentCause::torque_not_followed);
    clipped.torque_limit_Nm = 4;
    CHECK(ident::size_identification(request(), clipped).amplitude_Nm < 4);
    ident::SizingRequest narrow = request();
    narrow.distance_limit_m = 0.002;
    CHECK(ident::size_identification(narrow, found()).obstacle == IdentCause::no_room);
}

namespace {

constexpr int kBoth = 2;
// What an encoder does from a moment on: stands still, creeps within its step, counts backwards, or tells the
// other wheel's angle; nothing leaps. And the moment: in a push, while the right wheel is pushed alone, or
// with the first brake.
enum class Lie : std::uint8_t { stands, creeps, backwards, exchanged };
enum class From : std::uint8_t { push, right_ramp, brake };
// Two carts that know nothing of each other.
struct Carts {
    std::array<double, 2> mass_kg{12, 12}, rubs_Nm{0.4, 0.4};
    std::size_t reported_late_cycles = 0;
    int report_cycles = 1, blind_each_cycles = 0;  // and for forty of these
    double slope_Nm = 0;                           // on each wheel, from that moment on
    Lie lie = Lie::stands;
    From from = From::push;
    double fastest_m_per_s = 0, angle_noise_rad = 0;
    double lied_rad = 0;  // how far a wheel went since, at most
};

// Probes them, and has an encoder lie. `pushed`: for so many cycles since.
IdentCause probed(Carts& carts, int liar, double from_Nm, int* pushed = nullptr) {
    ident::ProbeOptions options;
    options.geometry = {{kRadius_m, kRadius_m}, kTrack_m};
    options.sample_time_s = 1e-3;
    options.sample_age_s = 2e-3 + 1e-3 * static_cast<double>(carts.reported_late_cycles);
    options.report_period_s = 1e-3 * carts.report_cycles;
    options.torque_limit_Nm = 5;
    options.speed_limit_m_per_s = 1.5;
    options.yaw_rate_limit_rad_per_s = 4;
    options.distance_limit_m = 2;
    ident::Probe probe;
    probe.start(options);
    std::array<double, 2> angle_rad{}, speed_rad_per_s{}, torque_Nm{}, told_rad{};
    std::array<std::deque<double>, 2> was_rad;
    std::array<double, 2> reported_rad{}, step_rad{};
    std::array<double, 2> lied_at_rad{}, true_at_rad{};
    bool has_begun = false;
    const auto tells = [&](std::size_t i, double own_rad, double other_rad) {
        if (!has_begun || (static_cast<int>(i) != liar && liar != kBoth)) return own_rad;
        switch (carts.lie) {
            case Lie::creeps:
                return lied_at_rad[i] + 1e-3 * (own_rad - lied_at_rad[i]);
            case Lie::backwards:
                return 2 * lied_at_rad[i] - own_rad;
            case Lie::exchanged:
                return lied_at_rad[i] + other_rad - lied_at_rad[1 - i];
            default:
                return lied_at_rad[i];
        }
    };
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> noise(-2e-4, 2e-4);
    for (int k = 0; k < 60'000 && !probe.finished(); ++k) {
        for (std::size_t i = 0; i < 2; ++i) {
            const double rubs_Nm = carts.rubs_Nm[i];
            const double acts_Nm = torque_Nm[i] + (has_begun ? carts.slope_Nm : 0);
            double pushed_Nm = acts_Nm - std::copysign(rubs_Nm, speed_rad_per_s[i]);
            if (speed_rad_per_s[i] == 0) pushed_Nm = acts_Nm - std::clamp(acts_Nm, -rubs_Nm, rubs_Nm);
            const double next =
                speed_rad_per_s[i] + 1e-3 * pushed_Nm / (carts.mass_kg[i] * kRadius_m * kRadius_m);
            speed_rad_per_s[i] = next * speed_rad_per_s[i] < 0 ? 0 : next;
            angle_rad[i] += 1e-3 * speed_rad_per_s[i];
            carts.fastest_m_per_s = std::max(carts.fastest_m_per_s, kRadius_m * std::abs(speed_rad_per_s[i]));
            auto& was = was_rad[i];
            was.push_back(angle_rad[i]);
            if (was.size() > carts.reported_late_cycles + 1) was.pop_front();
            if (k % carts.report_cycles == 0) {  // straight on from one report to the next, a report late
                const double before_rad = std::exchange(reported_rad[i], was.front() + noise(random));
                step_rad[i] = (reported_rad[i] - before_rad) / carts.report_cycles;
                told_rad[i] = before_rad;
            }
            told_rad[i] += step_rad[i];
            if (has_begun) carts.lied_rad = std::max(carts.lied_rad, std::abs(angle_rad[i] - true_at_rad[i]));
        }
        const bool blind = carts.blind_each_cycles > 0 && k % carts.blind_each_cycles < 40;
        const WheelPair<double> tell{tells(0, told_rad[0], told_rad[1]), tells(1, told_rad[1], told_rad[0])};
        const WheelPair<double> wanted = probe.step({tell, !blind, {}, {}, false, {}});
        torque_Nm = {wanted.left, wanted.right};
        if (pushed != nullptr && has_begun && wanted.left != 0) ++*pushed;
        const bool begins = carts.from == From::push
                                ? std::min(std::abs(wanted.left), std::abs(wanted.right)) >= from_Nm
                            : carts.from == From::brake ? wanted.left < 0
                                                        : wanted.left == 0 && wanted.right >= from_Nm;
        if (begins && !has_begun) {
            has_begun = true;
            lied_at_rad = told_rad;
            true_at_rad = angle_rad;
        }
    }
    carts.angle_noise_rad = probe.findings().angle_noise_rad;
    return probe.findings().fault;
}

}  // namespace

// Angles on a line between two reports have 0.82 of a report's noise, in the mean.
TEST(ProbeParts, the_noise_of_the_angles_is_that_of_their_reports_also_beside_gaps) {
    const double noise_rad = 2e-4 / std::sqrt(3);
    for (const int report_cycles : {1, 2, 5, 10}) {
        for (const int blind_each_cycles : {0, 310}) {
            Carts carts;
            carts.report_cycles = report_cycles;
            carts.reported_late_cycles = static_cast<std::size_t>(report_cycles / 2);
            carts.blind_each_cycles = blind_each_cycles;
            CHECK(probed(carts, -1, 5) == IdentCause::none);
            std::printf("each %d ms, a gap each %d ms: %.2f of a report's noise\n", report_cycles,
                        blind_each_cycles, carts.angle_noise_rad / noise_rad);
            CHECK(carts.angle_noise_rad > 0.7 * noise_rad);
            CHECK(carts.angle_noise_rad < 1.1 * noise_rad);
        }
    }
}

TEST(ProbeParts, a_wheel_that_stands_to_the_digit_while_the_other_one_turns_is_named) {
    Carts carts;
    CHECK(probed(carts, -1, 0.6) == IdentCause::none);
    CHECK(probed(carts, 0, 0.6) == IdentCause::left_wheel_does_not_turn);
    CHECK(probed(carts, 1, 0.6) == IdentCause::right_wheel_does_not_turn);
}

// A push is more than what has moved them.
TEST(ProbeParts, wheels_that_both_stand_to_the_digit_in_a_push_are_not_pushed_on) {
    int cycles = 0;
    Carts carts;
    CHECK(probed(carts, kBoth, 0.6, &cycles) == IdentCause::left_wheel_does_not_turn);
    CHECK(cycles > 50);
    CHECK(cycles <= 102);
}

// Its encoder's step is known by the noise of the pushes before.
TEST(ProbeParts, a_wheel_that_creeps_within_its_encoders_step_stands) {
    Carts carts;
    carts.lie = Lie::creeps;
    CHECK(probed(carts, 0, 0.6) == IdentCause::left_wheel_does_not_turn);
    CHECK(probed(carts, 1, 0.6) == IdentCause::right_wheel_does_not_turn);
}

// From rest a wheel goes the way that it is pushed, whatever the other one hands on.
TEST(ProbeParts, a_wheel_that_goes_against_a_push_is_named) {
    Carts carts;
    carts.lie = Lie::backwards;
    CHECK(probed(carts, 0, 0.6) == IdentCause::left_wheel_against_torque);
    CHECK(probed(carts, 1, 0.6) == IdentCause::right_wheel_against_torque);
    CHECK(carts.lied_rad < 0.1);
}

TEST(ProbeParts, a_wheel_that_is_pushed_alone_goes_further_than_the_other_one) {
    Carts carts;
    carts.lie = Lie::exchanged;
    carts.from = From::right_ramp;
    CHECK(probed(carts, kBoth, 0.1) == IdentCause::right_wheel_does_not_turn);
    CHECK(carts.lied_rad < 0.1);
}

// A brake that follows an encoder which counts backwards drives the wheel on.
TEST(ProbeParts, a_brake_that_makes_a_wheel_quicker_ends) {
    Carts carts;
    carts.rubs_Nm = {0.01, 0.01};
    CHECK(probed(carts, -1, 5) == IdentCause::none);
    carts.lie = Lie::backwards;
    carts.from = From::brake;
    int cycles = 0;
    const IdentCause found = probed(carts, 0, 0, &cycles);
    std::printf("%s, %d cycles of torque, at most %.3f m/s\n", protocol::to_string_view(found).data(), cycles,
                carts.fastest_m_per_s);
    CHECK(found == IdentCause::left_wheel_against_torque);
    CHECK(cycles < 100);
}

// Down a slope both wheels grow quicker in spite of it: that is no encoder's lie, and the brake helps.
TEST(ProbeParts, a_brake_stays_where_both_wheels_grow_quicker) {
    Carts carts;
    carts.rubs_Nm = {0.01, 0.01};
    carts.from = From::brake;
    carts.slope_Nm = 0.6;
    int cycles = 0;
    const IdentCause found = probed(carts, -1, 0, &cycles);
    std::printf("%s, %d cycles of torque, at most %.3f m/s\n", protocol::to_string_view(found).data(), cycles,
                carts.fastest_m_per_s);
    CHECK(cycles > 3000);
}

// A wheel in the air that weighs a sixtieth of what its motor moves on the floor is far beyond all limits
// before reports that come late show it, if it is pushed as a robot is. The ramp has shown it before.
TEST(ProbeParts, a_wheel_in_the_air_is_named_before_it_is_fast_also_where_reports_are_late) {
    for (const std::size_t lifted : {0U, 1U}) {
        for (const std::size_t late : {0U, 4U, 8U}) {
            for (const double rubs_Nm : {0.05, 0.2, 0.4}) {
                Carts carts;
                carts.mass_kg[lifted] = 0.2;
                carts.rubs_Nm[lifted] = rubs_Nm;
                carts.reported_late_cycles = late;
                const IdentCause found = probed(carts, -1, 5);
                std::printf("%zu cycles late, %.2f Nm: %s, at most %.2f m/s\n", late, rubs_Nm,
                            protocol::to_string_view(found).data(), carts.fastest_m_per_s);
                CHECK(found ==
                      (lifted == 0 ? IdentCause::left_wheel_off_ground : IdentCause::right_wheel_off_ground));
                CHECK(carts.fastest_m_per_s < 1.5);
            }
        }
    }
}

// By the motion's own integral, of wheels that three powers of ten lie between.
TEST(ProbeParts, a_ramp_tells_how_a_wheel_answers) {
    for (const double per_Nm : {0.2, 11.0, 400.0}) {
        ident::RampAnswer ramp;
        DOUBLES_EQUAL(0, ramp.per_Nm(2.5), 0);
        double speed = 0, way = 0;
        constexpr double kStep_s = 1e-5, kRise_Nm_per_s = 2.5;
        for (double t_s = 0; t_s < 0.04; t_s += kStep_s) {
            speed += kStep_s * per_Nm * kRise_Nm_per_s * t_s;
            way += kStep_s * speed;
            ramp.note(speed, way);
        }
        ramp.note(speed / 2, 10 * way);  // slower again
        DOUBLES_EQUAL(per_Nm, ramp.per_Nm(kRise_Nm_per_s), 0.01 * per_Nm);
    }
}
