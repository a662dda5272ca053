// The simulation's random numbers against published values and known moments.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>

#include "sim_hal/plain_math.hpp"
#include "sim_hal/random.hpp"
//
#include <CppUTest/TestHarness.h>

using wheelwright::sim::Random;

TEST_GROUP(SimRandom){};

TEST(SimRandom, the_generator_gives_the_published_sequence) {
    // xoshiro256++ seeded by splitmix64 with 0: the reference values of the Rust crate rand_xoshiro.
    constexpr std::array<std::uint64_t, 6> kPublished{5987356902031041503U, 7051070477665621255U,
                                                      6633766593972829180U, 211316841551650330U,
                                                      9136120204379184874U, 379361710973160858U};
    Random random(0);
    for (const std::uint64_t expected : kPublished) CHECK_EQUAL(expected, random.bits());
}

TEST(SimRandom, both_gaussians_have_mean_zero_variance_one_and_the_stated_kurtosis) {
    constexpr int kCount = 400'000;
    for (const bool fast : {false, true}) {
        Random random(7);
        double sum = 0;
        double square = 0;
        double fourth = 0;
        double largest = 0;
        for (int i = 0; i < kCount; ++i) {
            const double x = fast ? random.gaussian_fast() : random.gaussian();
            sum += x;
            square += x * x;
            fourth += x * x * x * x;
            largest = std::fmax(largest, std::fabs(x));
        }
        const double variance = square / kCount;
        const double kurtosis = fourth / kCount / (variance * variance);
        std::printf("gaussian%s: mean %.4f, variance %.4f, kurtosis %.3f, largest %.2f\n",
                    fast ? "_fast" : "", sum / kCount, variance, kurtosis, largest);
        DOUBLES_EQUAL(0, sum / kCount, 4 / std::sqrt(double{kCount}));
        DOUBLES_EQUAL(1, variance, 4 * std::sqrt(2.0 / kCount));
        DOUBLES_EQUAL(fast ? 2.7 : 2.9, kurtosis, 0.04);
        CHECK(largest < (fast ? 3.465 : 6.0));
    }
}

TEST(SimRandom, streams_of_one_seed_are_not_correlated) {
    constexpr int kCount = 100'000;
    Random one(5, 1);
    Random two(5, 2);
    double product = 0;
    for (int i = 0; i < kCount; ++i) product += one.gaussian() * two.gaussian();
    DOUBLES_EQUAL(0, product / kCount, 4 / std::sqrt(double{kCount}));
}

TEST(SimRandom, plain_functions_agree_with_the_library) {
    for (int i = 0; i <= 4000; ++i) {
        const double x = i * 0.01;
        DOUBLES_EQUAL(std::exp(-x), wheelwright::sim::exp_minus(x), 3e-15);
        if (i > 0) DOUBLES_EQUAL(-std::expm1(-x) / x, wheelwright::sim::mean_exp_minus(x), 3e-15);
        const double angle = (i - 2000) * 0.0137;
        const wheelwright::sim::SineCosine both = wheelwright::sim::sine_cosine(angle);
        DOUBLES_EQUAL(std::sin(angle), both.sine, 1e-14);
        DOUBLES_EQUAL(std::cos(angle), both.cosine, 1e-14);
    }
    DOUBLES_EQUAL(1, wheelwright::sim::mean_exp_minus(0), 0);
}
