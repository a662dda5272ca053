// Limits, judged by checkers that know the limits and nothing of the method.
#include <cmath>
#include <cstdio>
#include <string_view>

#include "firmware/control/limits.hpp"
#include "tests/control/bench_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

double pick(bench::Noise& noise, double size) {
    // dense near zero and near the limit, both signs
    const double choice = noise.uniform();
    const double sign = noise.uniform() < 0.5 ? -1 : 1;
    if (choice < 0.1) return 0;
    if (choice < 0.2) return sign * size;
    if (choice < 0.3) return sign * size * (1 + 1e-9);
    return sign * size * 3 * noise.uniform();
}

}  // namespace

TEST_GROUP(Limits){};

TEST(Limits, JointScalingKeepsTheCurvatureAndTheLimitsAndEnlargesNothing) {
    bench::Noise noise(11);
    for (int i = 0; i < 20'000; ++i) {
        const double v_limit = 0.7, w_limit = 2.3;
        const Twist<double> wanted{pick(noise, v_limit), pick(noise, w_limit)};
        LimiterFlags flags;
        const auto got = scale_jointly(wanted, v_limit, w_limit, flags);
        CHECK(std::abs(got.v_m_per_s) <= v_limit && std::abs(got.omega_rad_per_s) <= w_limit);
        DOUBLES_EQUAL(0, got.v_m_per_s * wanted.omega_rad_per_s - got.omega_rad_per_s * wanted.v_m_per_s,
                      1e-12);
        CHECK(got.v_m_per_s * wanted.v_m_per_s >= 0 && got.omega_rad_per_s * wanted.omega_rad_per_s >= 0);
        CHECK(std::abs(got.v_m_per_s) <= std::abs(wanted.v_m_per_s));
        const bool inside =
            std::abs(wanted.v_m_per_s) <= v_limit && std::abs(wanted.omega_rad_per_s) <= w_limit;
        CHECK_EQUAL(!inside, flags.bits != 0);
        if (!inside) {  // one of the two is at its limit
            CHECK(std::abs(std::abs(got.v_m_per_s) - v_limit) < 1e-12 ||
                  std::abs(std::abs(got.omega_rad_per_s) - w_limit) < 1e-12);
        }
    }
}

TEST(Limits, TorquesStayInTheBoxTurningHasPriorityAndTheSumKeepsItsShare) {
    bench::Noise noise(12);
    const double limit = 5;
    for (int i = 0; i < 20'000; ++i) {
        const WheelPair<double> wanted{pick(noise, limit), pick(noise, limit)};
        const double holds = i % 2 == 0 ? 0 : 0.8 * limit;
        const WheelPair<double> holding{pick(noise, holds), pick(noise, holds)};
        LimiterFlags flags;
        const auto got = limit_torque(wanted, holding, limit, flags);
        CHECK(std::abs(got.left) <= limit && std::abs(got.right) <= limit);
        const bool inside = std::abs(wanted.left) <= limit && std::abs(wanted.right) <= limit;
        CHECK_EQUAL(!inside, flags.bits != 0);
        const double sum = got.sum(), difference = got.difference();
        CHECK(sum * wanted.sum() >= -1e-12 && difference * wanted.difference() >= -1e-12);
        CHECK(std::abs(sum) <= std::abs(wanted.sum()) + 1e-12);
        CHECK(std::abs(difference) <= std::abs(wanted.difference()) + 1e-12);
        if (!flags.has(Limiter::torque_sum)) DOUBLES_EQUAL(wanted.sum(), sum, 1e-12);
        if (!flags.has(Limiter::torque_difference)) DOUBLES_EQUAL(wanted.difference(), difference, 1e-12);
        if (inside) {
            CHECK(got.left == wanted.left && got.right == wanted.right);
            continue;
        }
        DOUBLES_EQUAL(2 * limit, std::abs(sum) + std::abs(difference), 1e-9);  // nothing is given away
        // what holds the motion, and of the rest three and seven tenths
        const auto part = [](double holds_Nm, double all) {
            return holds_Nm * all > 0 ? std::abs(holds_Nm) : 0;
        };
        const double for_sum = part(holding.sum(), wanted.sum());
        const double for_difference = part(holding.difference(), wanted.difference());
        const double rest = std::max(2 * limit - for_sum - for_difference, 0.0);
        const double share = std::min(1.0, 2 * limit / (for_sum + for_difference));
        const double least_sum = std::min(std::abs(wanted.sum()), share * for_sum + 0.3 * rest);
        const double least_difference =
            std::min(std::abs(wanted.difference()), share * for_difference + 0.7 * rest);
        CHECK(std::abs(sum) >= least_sum - 1e-9);
        CHECK(std::abs(difference) >= least_difference - 1e-9);
    }
}

TEST(Limits, TheRateLimiterObeysInAllFourQuadrantsOfSpeedAndAcceleration) {
    bench::Noise noise(13);
    const double a = 1.7, alpha = 9.1, dt = 1e-3;
    TwistRateLimiter<double> limiter;
    limiter.configure(a, alpha);
    limiter.reset({0.3, -0.4});
    int quadrant[4] = {0, 0, 0, 0};
    for (int target = 0; target < 400; ++target) {
        const Twist<double> wanted{pick(noise, 1.1), pick(noise, 3.0)};
        const Twist<double> start = limiter.now();
        const double needed = std::max(std::abs(wanted.v_m_per_s - start.v_m_per_s) / a,
                                       std::abs(wanted.omega_rad_per_s - start.omega_rad_per_s) / alpha);
        const int cycles = static_cast<int>(needed / dt) + 2;
        for (int k = 0; k < cycles; ++k) {
            const Twist<double> before = limiter.now();
            LimiterFlags flags;
            const Twist<double> now = limiter.step(wanted, dt, flags);
            const double dv = now.v_m_per_s - before.v_m_per_s;
            const double dw = now.omega_rad_per_s - before.omega_rad_per_s;
            CHECK(std::abs(dv) <= a * dt * (1 + 1e-9) && std::abs(dw) <= alpha * dt * (1 + 1e-9));
            // between the last command and the target
            CHECK((now.v_m_per_s - before.v_m_per_s) * (wanted.v_m_per_s - now.v_m_per_s) >= -1e-18);
            CHECK((now.omega_rad_per_s - before.omega_rad_per_s) *
                      (wanted.omega_rad_per_s - now.omega_rad_per_s) >=
                  -1e-18);
            if (dv != 0) ++quadrant[(before.v_m_per_s > 0 ? 0 : 1) + (dv > 0 ? 0 : 2)];
        }
        DOUBLES_EQUAL(wanted.v_m_per_s, limiter.now().v_m_per_s,
                      1e-12);  // there in time, and no sooner than allowed
        DOUBLES_EQUAL(wanted.omega_rad_per_s, limiter.now().omega_rad_per_s, 1e-12);
    }
    for (const int count : quadrant) CHECK(count > 1000);
}

TEST(Limits, ATargetOfTheSameCurvatureIsReachedWithoutLeavingThePath) {
    // speed is what limits, then yaw rate
    for (const auto& limits : {Twist<double>{0.9, 31.0}, Twist<double>{40.0, 1.1}}) {
        TwistRateLimiter<double> limiter;
        limiter.configure(limits.v_m_per_s, limits.omega_rad_per_s);
        limiter.reset({-0.6, 0.9});
        LimiterFlags flags;
        for (int k = 0; k < 1000; ++k) {
            const auto now = limiter.step({1.2, -1.8}, 1e-3, flags);
            DOUBLES_EQUAL(0, now.omega_rad_per_s + 1.5 * now.v_m_per_s, 1e-12);
        }
        CHECK_EQUAL(limits.v_m_per_s < 1, flags.has(Limiter::acceleration));
        CHECK_EQUAL(limits.v_m_per_s > 1, flags.has(Limiter::yaw_acceleration));
    }
}

TEST(Limits, TheFlagNamesTheOneThatLimits) {
    LimiterFlags fast, turning;
    (void)scale_jointly(Twist<double>{3.0, 0.5}, 1.0, 2.0, fast);
    CHECK(fast.has(Limiter::speed) && !fast.has(Limiter::yaw_rate));
    (void)scale_jointly(Twist<double>{1.1, -9.0}, 1.0, 2.0, turning);
    CHECK(turning.has(Limiter::yaw_rate) && !turning.has(Limiter::speed));
}

TEST(Limits, ALimitOfZeroOrLessMeansZeroAndNotUnlimited) {
    LimiterFlags flags;
    const auto torque = limit_torque(WheelPair<double>{3, -2}, {}, -1.0, flags);
    CHECK(torque.left == 0 && torque.right == 0);
    CHECK(flags.has(Limiter::torque_sum) && flags.has(Limiter::torque_difference));
    const auto twist = scale_jointly(Twist<double>{3, -2}, 0.0, 1.0, flags);
    CHECK(twist.v_m_per_s == 0 && twist.omega_rad_per_s == 0);
    const auto negative = scale_jointly(Twist<double>{3, -2}, -1.0, -1.0, flags);
    CHECK(negative.v_m_per_s == 0 && negative.omega_rad_per_s == 0);
    TwistRateLimiter<double> limiter;
    limiter.configure(-1, -1);
    DOUBLES_EQUAL(0, limiter.step({1, 1}, 1e-3, flags).v_m_per_s, 0);
}

TEST(Limits, TheyHoldInSinglePrecisionToo) {
    bench::Noise noise(14);
    for (int i = 0; i < 5000; ++i) {
        LimiterFlags flags;
        const WheelPair<float> wanted{float(pick(noise, 5)), float(pick(noise, 5))};
        // also where one axis holds more than there is, and the other nothing
        const float holds = float(pick(noise, 9));
        const auto t = limit_torque(wanted, {holds, i % 2 == 0 ? holds : float(pick(noise, 9))}, 5.0F, flags);
        CHECK(std::abs(t.left) <= 5.0F && std::abs(t.right) <= 5.0F);
    }
}

TEST(Limits, WhatIsNamedIsWhatWasCutAndNothingElse) {
    struct Case {
        WheelPair<double> wanted_Nm;
        bool sum, difference;
    };
    for (const Case& one :
         {Case{{7, 7}, true, false}, Case{{-7, -7}, true, false}, Case{{7, -7}, false, true},
          Case{{8, 4}, true, false}, Case{{1, 12}, true, true}}) {
        LimiterFlags flags;
        limit_torque(one.wanted_Nm, {}, 5.0, flags);
        CHECK_EQUAL(one.sum, flags.has(Limiter::torque_sum));
        CHECK_EQUAL(one.difference, flags.has(Limiter::torque_difference));
    }
}

TEST(Limits, AYawRateLimitBelowZeroMeansZeroToo) {
    for (const double limit_rad_per_s : {0.0, -2.0}) {
        LimiterFlags flags;
        const Twist<double> none = scale_jointly<double>({0, 0.5}, 1, limit_rad_per_s, flags);
        DOUBLES_EQUAL(0, none.omega_rad_per_s, 0);
        CHECK(flags.has(Limiter::yaw_rate));
    }
}

namespace {

struct Turn {
    double limit_Nm;
    model::Dynamics<double> k;
    Twist<double> asked;
};

// Now and then of a robot whose turns do not push it, or do not grow.
Turn drawn_turn(bench::Noise& noise, int i) {
    const double limit_Nm = 0.1 + 10 * noise.uniform();
    const double k5_m = i % 3 == 0 ? 0 : pick(noise, 0.5), k6_per_m = i % 3 == 1 ? 0 : pick(noise, 3);
    const double k7 = 0.01 + 3 * noise.uniform(), k8 = 0.01 + 10 * noise.uniform();
    const double v = pick(noise, 2);
    return {limit_Nm, {k5_m, k6_per_m, k7, k8}, {v, pick(noise, 4)}};
}

}  // namespace

// Judged by eq (43): the torque that would keep the speed, and stop the yaw rate from growing.
TEST(Limits, ATurnThatPushesOrGrowsByItselfIsKeptToWhatHalfOfTheTorqueHolds) {
    bench::Noise noise(43);
    int held = 0;
    for (int i = 0; i < 10'000; ++i) {
        const auto [limit_Nm, k, asked] = drawn_turn(noise, i);
        const auto [v, omega] = asked;
        LimiterFlags flags;
        const double kept = hold_yaw_rate(omega, v, k, limit_Nm, flags);
        const auto needed_Nm = [&](double yaw_rate) {
            const double sum = std::abs(k.k5_m * yaw_rate * yaw_rate / k.k7_per_kg_m);
            const double difference = k.k6_per_m * v * yaw_rate / k.k8_per_kg_m2;
            return sum + (difference * yaw_rate > 0 ? std::abs(difference) : 0);
        };
        const bool too_much = needed_Nm(omega) > limit_Nm;  // of twice the limit, for both wheels
        CHECK_EQUAL(too_much, flags.has(Limiter::yaw_rate));
        if (too_much) {
            DOUBLES_EQUAL(limit_Nm, needed_Nm(kept), 1e-9 * limit_Nm);
            CHECK(kept * omega > 0);
            ++held;
        } else {
            DOUBLES_EQUAL(omega, kept, 0);
        }
    }
    CHECK(held > 500);
    LimiterFlags flags;
    DOUBLES_EQUAL(0, hold_yaw_rate(1.0, -1.0, model::Dynamics<double>{0, -1, 1, 1}, -1.0, flags), 0);
    DOUBLES_EQUAL(0, hold_yaw_rate(1.0, 1.0, model::Dynamics<double>{0.1, -1, 1, 1}, -1.0, flags), 0);
}

// By the same equation, and whichever way the turn pushes.
TEST(Limits, ACurveIsDrivenAsFastAsHalfOfTheTorqueHolds) {
    bench::Noise noise(44);
    int slowed = 0;
    for (int i = 0; i < 10'000; ++i) {
        const auto [limit_Nm, k, asked] = drawn_turn(noise, i);
        LimiterFlags flags;
        const Twist<double> kept = hold_curve(asked, k, limit_Nm, flags);
        const auto needed_Nm = [&](const Twist<double>& twist) {
            const double omega = twist.omega_rad_per_s;
            return std::abs(k.k5_m * omega * omega / k.k7_per_kg_m) +
                   std::abs(k.k6_per_m * twist.v_m_per_s * omega / k.k8_per_kg_m2);
        };
        const bool too_much = needed_Nm(asked) > limit_Nm;
        CHECK_EQUAL(too_much, flags.has(Limiter::yaw_rate));
        DOUBLES_EQUAL(asked.omega_rad_per_s * kept.v_m_per_s, asked.v_m_per_s * kept.omega_rad_per_s, 1e-12);
        DOUBLES_EQUAL(too_much ? limit_Nm : needed_Nm(asked), needed_Nm(kept), 1e-9 * limit_Nm);
        CHECK(kept.omega_rad_per_s * asked.omega_rad_per_s >= 0);
        slowed += too_much;
    }
    CHECK(slowed > 500);
    LimiterFlags flags;
    const Twist<double> none = hold_curve<double>({1, 1}, {0.1, -1, 1, 1}, -1.0, flags);
    DOUBLES_EQUAL(0, none.v_m_per_s, 0);
    DOUBLES_EQUAL(0, none.omega_rad_per_s, 0);
    DOUBLES_EQUAL(1, hold_curve<double>({1, 0}, {0.1, -1, 1, 1}, -1.0, flags).v_m_per_s, 0);  // is no turn
}

TEST(Limits, EachLimiterHasAName) {
    for (const std::string_view name : kLimiterNames) CHECK_FALSE(name.empty());
}

TEST(Limits, TheTorqueIsLimitedInSumOrInDifference) {
    for (unsigned i = 0; i < 6; ++i) {
        LimiterFlags flags;
        CHECK_FALSE(flags.torque_limited());
        flags.set(Limiter(i));
        CHECK_EQUAL(Limiter(i) == Limiter::torque_sum || Limiter(i) == Limiter::torque_difference,
                    flags.torque_limited());
    }
}

TEST(Limits, HalfOfTheTorqueIsTheUsualAccelerationWhereTheLimitsAllowIt) {
    model::RobotParameters p = model::default_parameters();
    p.limits.torque_Nm = 4;
    p.limits.speed_m_per_s = 3;
    p.limits.yaw_rate_rad_per_s = 8;
    p.dynamics.k7_per_kg_m = 0.5;
    p.dynamics.k8_per_kg_m2 = 2;
    p.limits.acceleration_m_per_s2 = p.limits.yaw_acceleration_rad_per_s2 = 100;
    DOUBLES_EQUAL(2, usual_acceleration(p).v_m_per_s2, 1e-12);
    DOUBLES_EQUAL(8, usual_acceleration(p).omega_rad_per_s2, 1e-12);
    DOUBLES_EQUAL(1.5, braking_time_s(p), 1e-12);
    p.limits.yaw_rate_rad_per_s = 16;
    DOUBLES_EQUAL(2, braking_time_s(p), 1e-12);
    p.limits.acceleration_m_per_s2 = 0.75;
    p.limits.yaw_acceleration_rad_per_s2 = 5;
    DOUBLES_EQUAL(0.75, usual_acceleration(p).v_m_per_s2, 1e-12);
    DOUBLES_EQUAL(5, usual_acceleration(p).omega_rad_per_s2, 1e-12);
    DOUBLES_EQUAL(4, braking_time_s(p), 1e-12);
}

TEST(Limits, ARateLimiterNamesOnlyWhatHindersIt) {
    TwistRateLimiter<double> limiter;
    limiter.configure(0.5, 0.25);
    for (const Twist<double>& reached : {Twist<double>{0.25, 0}, Twist<double>{0, 0.125}}) {  // just reached
        LimiterFlags flags;
        limiter.reset({0, 0});
        DOUBLES_EQUAL(reached.v_m_per_s, limiter.step(reached, 0.5, flags).v_m_per_s, 0);
        CHECK_EQUAL(0U, unsigned(flags.bits));
    }
    LimiterFlags flags;
    limiter.reset({0, 0});
    limiter.step({1, 0.5}, 0.5, flags);  // both by the same share
    CHECK(flags.has(Limiter::acceleration));
    CHECK_FALSE(flags.has(Limiter::yaw_acceleration));
}

TEST(Limits, ARateLimiterTakesSmallAccelerationsAndBeginsWhereItIsTold) {
    TwistRateLimiter<double> limiter;
    limiter.configure(0.5, 0.25);
    limiter.reset({1, -1});
    DOUBLES_EQUAL(1, limiter.now().v_m_per_s, 0);
    DOUBLES_EQUAL(-1, limiter.now().omega_rad_per_s, 0);
    LimiterFlags flags;
    DOUBLES_EQUAL(1.05, limiter.step({2, -1}, 0.1, flags).v_m_per_s, 1e-12);
    CHECK(flags.has(Limiter::acceleration));
    limiter.reset({0, 0});
    flags = {};
    DOUBLES_EQUAL(0.025, limiter.step({0, 2}, 0.1, flags).omega_rad_per_s, 1e-12);
    CHECK(flags.has(Limiter::yaw_acceleration));
}
