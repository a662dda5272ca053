#include <cmath>
#include <cstdio>
#include <random>

#include "firmware/ident/coloured_errors.hpp"
#include "firmware/ident/excitation_monitor.hpp"
#include "firmware/ident/score_errors.hpp"
#include "firmware/ident/ud_rls.hpp"
#include "tests/support/seeds.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::ident;

namespace {

struct Honesty {
    double slow, fast;              // rms z of the two parameters
    double naive_slow, naive_fast;  // with the residual's variance times P
};

// y = 0.5 slow(t) + 2 fast(t) + noise: white noise of deviation `plant` through the rows' averaging weight,
// and white noise of deviation `sensor` differenced `order` times. Rms of the estimates' errors over their
// standard errors.
template <typename Real>
Honesty monte_carlo(int order, double sensor, double plant, double lambda, int rows) {
    constexpr int kTrials = wheelwright::test::seeds(400);
    Honesty sum{};
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    for (int trial = 0; trial < kTrials; ++trial) {
        UdRls<Real, 2> rls;
        rls.reset({0, 0}, {Real(1e5), Real(1e5)});
        if (lambda < 1) rls.set_forgetting(Forgetting::exponential, static_cast<Real>(lambda));
        ColouredErrors<Real, 2> errors;
        errors.reset(order, 2, static_cast<Real>(lambda));
        double n[3] = {normal(random), normal(random), normal(random)};
        double slow = 0;
        double fine[30];  // the plant's noise, ten to a row: its weight spans three
        for (double& w : fine) w = normal(random);
        for (int k = 0; k < rows; ++k) {
            slow += 0.02 * (normal(random) - slow * 0.02);
            const double fast = normal(random);
            double noise = 0;
            if (order == 0) noise = sensor * n[0];
            if (order == 1) noise = sensor * (n[0] - n[1]) + plant * fine[0];
            if (order == 2) {
                noise = sensor * (n[0] - 2 * n[1] + n[2]);
                for (int i = 0; i < 30; ++i) {  // quadratic B-spline over three rows
                    const double x = (i + 0.5) / 10 - 1.5;
                    const double weight =
                        std::abs(x) < 0.5 ? 0.75 - x * x : (1.5 - std::abs(x)) * (1.5 - std::abs(x)) / 2;
                    noise += plant * weight * fine[i] / std::sqrt(10.0);
                }
            }
            const std::array<Real, 2> phi{static_cast<Real>(slow), static_cast<Real>(fast)};
            const Real innovation = rls.update(phi, static_cast<Real>(0.5 * slow + 2 * fast + noise));
            errors.push(phi, innovation);
            n[2] = n[1];
            n[1] = n[0];
            n[0] = normal(random);
            for (int i = 0; i < 20; ++i) fine[i] = fine[i + 10];
            for (int i = 20; i < 30; ++i) fine[i] = normal(random);
            if (order == 1) fine[0] = normal(random);
        }
        const auto variances = errors.noise_variances();
        const auto square = [&](int i, double truth, bool naive) {
            const std::array<Real, 2> p{rls.covariance(i, 0), rls.covariance(i, 1)};
            const double variance = naive ? static_cast<double>(errors.residual_variance() * rls.variance(i))
                                          : static_cast<double>(errors.covariance(variances, p, p));
            return std::pow(static_cast<double>(rls.theta()[static_cast<std::size_t>(i)]) - truth, 2) /
                   variance / kTrials;
        };
        sum.slow += square(0, 0.5, false);
        sum.fast += square(1, 2, false);
        sum.naive_slow += square(0, 0.5, true);
        sum.naive_fast += square(1, 2, true);
    }
    return {std::sqrt(sum.slow), std::sqrt(sum.fast), std::sqrt(sum.naive_slow), std::sqrt(sum.naive_fast)};
}

}  // namespace

TEST_GROUP(ColouredResiduals){static void expect_honest(const char* what, const Honesty& h){
    std::printf("\n  %-44s slow %.2f (naive %.2f), fast %.2f (naive %.2f)", what, h.slow, h.naive_slow,
                h.fast, h.naive_fast);
if (!wheelwright::test::all_seeds()) return;
CHECK(h.slow > 0.8 && h.slow < 1.25);
CHECK(h.fast > 0.8 && h.fast < 1.25);
}
}
;

TEST(ColouredResiduals, have_honest_standard_errors_for_each_colour) {
    expect_honest("white", monte_carlo<double>(0, 0.3, 0, 1, 1500));
    expect_honest("differenced, with plant noise", monte_carlo<double>(1, 0.3, 0.05, 1, 2500));
    expect_honest("twice differenced, with plant noise", monte_carlo<double>(2, 0.3, 0.05, 1, 2500));
    expect_honest("plant noise alone, rows overlap", monte_carlo<double>(2, 0, 0.3, 1, 1500));
    expect_honest("the same in float", monte_carlo<float>(2, 0.3, 0.05, 1, 2500));
    std::printf("\n");
}

TEST(ColouredResiduals, have_honest_standard_errors_under_exponential_forgetting) {
    expect_honest("forgetting 0.998, differenced", monte_carlo<double>(1, 0.3, 0.05, 0.998, 4000));
    expect_honest("forgetting 0.998, twice differenced", monte_carlo<double>(2, 0.3, 0.05, 0.998, 4000));
    std::printf("\n");
}

TEST(ColouredResiduals, say_nothing_before_there_is_anything) {
    ColouredErrors<double, 2> errors;
    errors.reset(2);
    DOUBLES_EQUAL(0, errors.residual_variance(), 0);
    errors.push({1, 2}, 3);
    DOUBLES_EQUAL(0, errors.noise_variances().sensor, 0);
}

namespace {

enum class Colour { white, twice_differenced, wandering, grows_with_the_regressor };

// y = 0.5 slow(t) + 2 fast(t) + noise. Rms z and coverage of the 95 % intervals from the scores.
struct Scores {
    double slow, fast, slow_covered, fast_covered;
};

template <typename Real>
Scores scores(Colour colour, int rows) {
    constexpr int kTrials = wheelwright::test::seeds(400);
    Scores sum{};
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    for (int trial = 0; trial < kTrials; ++trial) {
        UdRls<Real, 2> rls;
        rls.reset({0, 0}, {Real(1e5), Real(1e5)});
        ScoreErrors<Real, 2> errors;
        errors.reset();
        double n[3] = {normal(random), normal(random), normal(random)};
        double slow = 0;
        double wander = 0;
        for (int k = 0; k < rows; ++k) {
            slow += 0.02 * normal(random) - 0.02 * 0.02 * slow;
            const double fast = normal(random);
            wander += 0.3 * (normal(random) - wander);
            double noise = 0.3 * n[0];
            if (colour == Colour::twice_differenced) noise = 0.3 * (n[0] - 2 * n[1] + n[2]) + 0.05 * wander;
            if (colour == Colour::wandering) noise = wander;
            if (colour == Colour::grows_with_the_regressor) noise *= std::abs(fast);
            const std::array<Real, 2> phi{static_cast<Real>(slow), static_cast<Real>(fast)};
            const Real variance = rls.projection(phi).variance;
            const Real innovation = rls.update(phi, static_cast<Real>(0.5 * slow + 2 * fast + noise));
            errors.push(phi, innovation / std::sqrt(1 + variance));
            n[2] = n[1];
            n[1] = n[0];
            n[0] = normal(random);
        }
        const auto z = [&](int i, double truth) {
            const std::array<Real, 2> p{rls.covariance(i, 0), rls.covariance(i, 1)};
            return (static_cast<double>(rls.theta()[static_cast<std::size_t>(i)]) - truth) /
                   std::sqrt(static_cast<double>(errors.covariance(p, p)));
        };
        const double a = z(0, 0.5);
        const double b = z(1, 2);
        sum.slow += a * a / kTrials;
        sum.fast += b * b / kTrials;
        sum.slow_covered += (std::abs(a) < 1.96 ? 1.0 : 0.0) / kTrials;
        sum.fast_covered += (std::abs(b) < 1.96 ? 1.0 : 0.0) / kTrials;
    }
    sum.slow = std::sqrt(sum.slow);
    sum.fast = std::sqrt(sum.fast);
    return sum;
}

}  // namespace

TEST_GROUP(StandardErrorsFromScores){static void expect_honest(const char* what, const Scores& s){
    std::printf("\n  %-44s slow: rms z %.2f, covered %.3f; fast: rms z %.2f, covered %.3f", what, s.slow,
                s.slow_covered, s.fast, s.fast_covered);
if (!wheelwright::test::all_seeds()) return;
CHECK(s.slow > 0.8 && s.slow < 1.25);
CHECK(s.fast > 0.8 && s.fast < 1.25);
CHECK(s.slow_covered > 0.88 && s.slow_covered < 0.99);
CHECK(s.fast_covered > 0.88 && s.fast_covered < 0.99);
}
}
;

TEST(StandardErrorsFromScores, are_honest_for_colours_nobody_told_them_of) {
    expect_honest("white", scores<double>(Colour::white, 1000));
    expect_honest("sensor noise twice differenced, and a little more",
                  scores<double>(Colour::twice_differenced, 2500));
    expect_honest("noise that wanders", scores<double>(Colour::wandering, 1500));
    expect_honest("noise that grows with the regressor",
                  scores<double>(Colour::grows_with_the_regressor, 1000));
    expect_honest("the same in float", scores<float>(Colour::grows_with_the_regressor, 1000));
    std::printf("\n");
}

TEST(StandardErrorsFromScores, of_few_rows_there_are_none) {
    ScoreErrors<double, 2> errors;
    errors.reset();
    for (std::uint32_t k = 1; k < errors.fewest_rows(); ++k) errors.push({1, 2}, k % 2 == 0 ? 1.0 : -1.0);
    DOUBLES_EQUAL(0, errors.covariance({1, 0}, {1, 0}), 0);
    errors.push({1, 2}, 1);
    CHECK(errors.covariance({1, 0}, {1, 0}) > 0);
}

TEST_GROUP(ExcitationOfParameters){};

TEST(ExcitationOfParameters, counts_only_what_the_other_columns_cannot_explain) {
    ExcitationMonitor<double, 3> monitor;
    monitor.reset(0.99, {10, 10, 10});
    for (int k = 0; k < 2000; ++k) {
        const double a = std::sin(0.3 * k);
        monitor.push({a, 2.0, 2.0});  // the last two always go together
    }
    // sum of a^2 with memory 100: 50; nothing known of the difference of the other two
    DOUBLES_EQUAL(50, monitor.information(0), 2);
    CHECK(monitor.information(1) < 0.11);
    CHECK(monitor.information(2) < 0.11);
    DOUBLES_EQUAL(0.5, monitor.excitation(0, 0.01), 0.03);
}

TEST(ExcitationOfParameters, fades_when_the_motion_ends) {
    ExcitationMonitor<float, 2> monitor;
    monitor.reset(0.98F, {4, 4});
    DOUBLES_EQUAL(0, monitor.information(0), 0);
    for (int k = 0; k < 300; ++k) monitor.push({k % 2 == 0 ? 1.0F : -1.0F, k % 3 == 0 ? 1.0F : 0.0F});
    CHECK(monitor.information(0) > 30);
    for (int k = 0; k < 3000; ++k) monitor.push({0, 0});
    CHECK(monitor.information(0) < 1e-3F);
    CHECK(monitor.information(1) < 1e-3F);
}
