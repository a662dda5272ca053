#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "firmware/ident/excitation.hpp"
#include "firmware/ident/prbs.hpp"
#include "tests/ident/test_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using ident::kPrbsLeft;
using ident::kPrbsRight;
using ident::Prbs;
using ident::PrbsRegister;
using test::RobotTruth;
using test::TestRobot;

namespace {

// Arithmetic of polynomials over GF(2) modulo the register's: an independent proof of its period.
struct Field {
    std::uint64_t modulus;
    unsigned length;

    std::uint64_t times(std::uint64_t a, std::uint64_t b) const {
        std::uint64_t product = 0;
        for (; b != 0; b >>= 1U) {
            if ((b & 1U) != 0) product ^= a;
            a <<= 1U;
            if ((a >> length & 1U) != 0) a ^= modulus;
        }
        return product;
    }
    std::uint64_t power_of_x(std::uint64_t exponent) const {
        std::uint64_t result = 1;
        std::uint64_t square = 2;
        for (; exponent != 0; exponent >>= 1U) {
            if ((exponent & 1U) != 0) result = times(result, square);
            square = times(square, square);
        }
        return result;
    }
};

Field field_of(const PrbsRegister& r) {
    return {(std::uint64_t{1} << r.length) | (std::uint64_t{1} << r.tap) | 1U, r.length};
}

std::vector<double> bits(const PrbsRegister& r, std::uint32_t seed, std::size_t count) {
    Prbs prbs(r, seed, 1);
    std::vector<double> values(count);
    for (double& v : values) v = prbs.next();
    return values;
}

double correlation(const std::vector<double>& a, const std::vector<double>& b, std::size_t lag) {
    double sum = 0;
    for (std::size_t i = lag; i < a.size(); ++i) sum += a[i] * b[i - lag];
    return sum / static_cast<double>(a.size() - lag);
}

}  // namespace

TEST_GROUP(PseudoRandomBits){};

TEST(PseudoRandomBits, short_registers_go_through_all_states) {
    for (const PrbsRegister r : {PrbsRegister{7, 6}, {9, 5}, {11, 9}, {17, 14}, {20, 17}}) {
        Prbs prbs(r, 0, 1);
        const std::uint32_t start = prbs.state();
        std::uint32_t period = 0;
        long sum = 0;
        do {
            sum += prbs.next();
            ++period;
        } while (prbs.state() != start && period < (2U << r.length));
        LONGS_EQUAL((1U << r.length) - 1, period);
        LONGS_EQUAL(1, std::abs(sum));  // ones outnumber zeros by one
    }
}

TEST(PseudoRandomBits, the_wheels_registers_have_maximal_length) {
    // x has the order 2^n - 1 iff x^(2^n - 1) = 1 and no x^((2^n - 1) / q) is, q the prime factors
    LONGS_EQUAL(29, kPrbsLeft.length);
    const Field left = field_of(kPrbsLeft);
    const std::uint64_t period = (1ULL << 29U) - 1;  // = 233 * 1103 * 2089
    CHECK(left.power_of_x(period) == 1);
    for (const std::uint64_t factor : {233ULL, 1103ULL, 2089ULL})
        CHECK(left.power_of_x(period / factor) != 1);
    LONGS_EQUAL(31, kPrbsRight.length);
    CHECK(field_of(kPrbsRight).power_of_x((1ULL << 31U) - 1) == 1);  // 2^31 - 1 is a prime
}

TEST(PseudoRandomBits, the_wheels_sequences_and_their_products_are_uncorrelated) {
    constexpr std::size_t kBits = 100000;
    double worst = 0;
    for (const std::uint32_t seed : {0U, 1U, 2U, 77U}) {
        const auto left = bits(kPrbsLeft, seed, kBits);
        const auto right = bits(kPrbsRight, seed, kBits);
        std::vector<double> product(kBits);
        for (std::size_t i = 0; i < kBits; ++i) product[i] = left[i] * right[i];
        for (std::size_t lag = 0; lag < 40; ++lag) {
            worst = std::max(worst, std::abs(correlation(left, right, lag)));
            worst = std::max(worst, std::abs(correlation(right, left, lag)));
            worst = std::max(worst, std::abs(correlation(left, product, lag)));
            worst = std::max(worst, std::abs(correlation(right, product, lag)));
            if (lag > 0) worst = std::max(worst, std::abs(correlation(left, left, lag)));
            if (lag > 0) worst = std::max(worst, std::abs(correlation(right, right, lag)));
        }
    }
    std::printf("\n  worst of 944 correlations over %zu bits: %.4f (a deviation is 0.0032)\n", kBits, worst);
    CHECK(worst < 5 / std::sqrt(static_cast<double>(kBits)));
}

TEST(PseudoRandomBits, a_bit_lasts_as_many_samples_as_asked) {
    Prbs fast(kPrbsLeft, 3, 1);
    Prbs slow(kPrbsLeft, 3, 7);
    for (int bit = 0; bit < 1000; ++bit) {
        const int expected = fast.next();
        for (int i = 0; i < 7; ++i) LONGS_EQUAL(expected, slow.next());
    }
}

TEST_GROUP(ExcitationLimits) {
    // The judge sees the true motion only.
    struct Extremes {
        double v = 0, omega = 0, distance = 0, overridden = 0;
    };
    static Extremes drive(double mass_factor, double bit_time_s, unsigned seed, double seconds) {
        RobotTruth truth;
        truth.k7 /= mass_factor;
        truth.k8 /= mass_factor;
        truth.coulomb_left_Nm = 0.25;
        truth.coulomb_right_Nm = 0.35;
        TestRobot robot(truth, seed);
        ident::Excitation<double> excitation;
        excitation.start({5, bit_time_s, 0.001, 0.8, 5, 1.5}, {}, seed);
        Extremes worst;
        const int cycles = static_cast<int>(seconds * 1000);
        for (int k = 0; k < cycles; ++k) {
            const WheelPair<double> torque = excitation.step(robot.odometry(), robot.velocity());
            CHECK(std::abs(torque.left) <= 5 && std::abs(torque.right) <= 5);
            robot.step(torque.left, torque.right);
            worst.v = std::max(worst.v, std::abs(robot.true_velocity().v_m_per_s));
            worst.omega = std::max(worst.omega, std::abs(robot.true_velocity().omega_rad_per_s));
            worst.distance = std::max(worst.distance, robot.true_distance_m());
        }
        worst.overridden = static_cast<double>(excitation.overridden_cycles()) / cycles;
        return worst;
    }
};

TEST(ExcitationLimits, hold_for_the_notes_robot_a_light_one_and_a_heavy_one) {
    for (const double mass : {1.0, 0.5, 2.5}) {
        Extremes worst;
        for (unsigned seed = 1; seed <= 8; ++seed) {
            const Extremes one = drive(mass, 0.01, seed, 45);
            worst.v = std::max(worst.v, one.v);
            worst.omega = std::max(worst.omega, one.omega);
            worst.distance = std::max(worst.distance, one.distance);
            worst.overridden = std::max(worst.overridden, one.overridden);
        }
        std::printf(
            "\n  mass x %.1f: |v| %.3f of 0.8 m/s, |omega| %.2f of 5 rad/s, %.2f of 1.5 m, %.0f %% "
            "overridden",
            mass, worst.v, worst.omega, worst.distance, 100 * worst.overridden);
        CHECK(worst.v <= 0.8);
        CHECK(worst.omega <= 5);
        CHECK(worst.distance <= 1.5);
        CHECK(worst.overridden < 0.3);
    }
    std::printf("\n");
}

TEST(ExcitationLimits, hold_with_long_bits_too) {
    for (unsigned seed = 1; seed <= 6; ++seed) {
        const Extremes worst = drive(1, 0.25, seed, 60);
        CHECK(worst.v <= 0.8);
        CHECK(worst.omega <= 5);
        CHECK(worst.distance <= 1.5);
    }
}
