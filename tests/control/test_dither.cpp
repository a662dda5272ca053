// The dither by its own statements: amplitudes at the rim, rates that are the speeds' derivatives, no mean,
// and nothing where a wheel hardly turns.
#include <algorithm>
#include <cmath>

#include "firmware/control/dither.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

constexpr double kCycle_s = 0.001, kTrack_m = 0.43, kPeriod_s = 0.21;
constexpr Twist<double> kLimit{1.5, 4};

VelocityReference<double> beside(Dither<double>& dither, double v, double omega) {
    VelocityReference<double> reference;
    reference.twist = {v, omega};
    dither.step(reference);
    reference.twist.v_m_per_s -= v;
    reference.twist.omega_rad_per_s -= omega;
    return reference;
}

}  // namespace

TEST_GROUP(Dither){};

TEST(Dither, has_its_amplitudes_and_its_rates_are_derivatives) {
    Dither<double> dither;
    dither.configure(kPeriod_s, kCycle_s, kTrack_m, kLimit);
    dither.set_amplitudes(0.2, 0.3);
    for (int k = 0; k < 1000; ++k) beside(dither, 0.5, 0.1);  // fades in
    double largest_v_rate = 0, largest_rim_rate = 0, sum_v = 0, sum_omega = 0;
    VelocityReference<double> before = beside(dither, 0.5, 0.1), now = beside(dither, 0.5, 0.1);
    constexpr int kCycles = 1'000'000;
    for (int k = 0; k < kCycles; ++k) {
        const VelocityReference<double> next = beside(dither, 0.5, 0.1);
        DOUBLES_EQUAL((next.twist.v_m_per_s - before.twist.v_m_per_s) / (2 * kCycle_s), now.rate.v_m_per_s2,
                      1e-4);
        DOUBLES_EQUAL((next.twist.omega_rad_per_s - before.twist.omega_rad_per_s) / (2 * kCycle_s),
                      now.rate.omega_rad_per_s2, 5e-4);
        largest_v_rate = std::max(largest_v_rate, std::abs(next.rate.v_m_per_s2));
        largest_rim_rate = std::max(largest_rim_rate, std::abs(next.rate.omega_rad_per_s2) * kTrack_m / 2);
        sum_v += next.twist.v_m_per_s;
        sum_omega += next.twist.omega_rad_per_s;
        before = now;
        now = next;
    }
    DOUBLES_EQUAL(0.2, largest_v_rate, 1e-4);
    DOUBLES_EQUAL(0.3, largest_rim_rate, 1e-4);
    DOUBLES_EQUAL(0, sum_v / kCycles, 1e-5);  // of a last wave that is not whole
    DOUBLES_EQUAL(0, sum_omega / kCycles, 1e-5);
}

TEST(Dither, fades_away_where_a_wheel_hardly_turns_and_without_amplitudes_is_none) {
    Dither<double> dither;
    dither.configure(kPeriod_s, kCycle_s, kTrack_m, kLimit);
    for (int k = 0; k < 1000; ++k) CHECK_EQUAL(0.0, beside(dither, 0.5, 0.1).rate.v_m_per_s2);
    dither.set_amplitudes(0.2, 0.3);
    double largest = 0;
    for (int k = 0; k < 1000; ++k)
        largest = std::max(largest, std::abs(beside(dither, 0.5, 0.1).rate.v_m_per_s2));
    CHECK(largest > 0.19);
    const double pivot = 0.5 / (kTrack_m / 2);  // the left wheel stands
    for (int k = 0; k < 211; ++k) beside(dither, 0.5, pivot);
    for (int k = 0; k < 1000; ++k) CHECK_EQUAL(0.0, beside(dither, 0.5, pivot).rate.v_m_per_s2);
}

// Beside a path that drives at its limits or beyond them (a limiter that is behind), it adds to neither.
TEST(Dither, passes_no_limit_of_speed) {
    Dither<double> dither;
    dither.configure(kPeriod_s, kCycle_s, kTrack_m, kLimit);
    dither.set_amplitudes(0.6, 0.9);
    int cut_off = 0;
    double slowest_m_per_s = 0, slowest_rad_per_s = 0;
    for (int k = 0; k < 3000; ++k) {
        const VelocityReference<double> ahead = beside(dither, kLimit.v_m_per_s, -kLimit.omega_rad_per_s);
        CHECK(ahead.twist.v_m_per_s <= 1e-12);
        CHECK(ahead.twist.omega_rad_per_s >= -1e-12);
        slowest_m_per_s = std::min(slowest_m_per_s, ahead.twist.v_m_per_s);
        slowest_rad_per_s = std::max(slowest_rad_per_s, ahead.twist.omega_rad_per_s);
        if (ahead.twist.v_m_per_s == 0 && ahead.rate.v_m_per_s2 == 0) ++cut_off;
    }
    CHECK(cut_off > 1400);           // of 1500
    CHECK(slowest_m_per_s < -0.01);  // it still tells the mass
    CHECK(slowest_rad_per_s > 0.05);
    CHECK(beside(dither, -1.1 * kLimit.v_m_per_s, 0.1).twist.v_m_per_s >= -1e-12);
}
