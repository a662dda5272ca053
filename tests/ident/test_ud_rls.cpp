#include <cmath>
#include <cstdio>
#include <random>

#include <Eigen/Dense>

#include "firmware/ident/arx.hpp"
#include "firmware/ident/prbs.hpp"
#include "firmware/ident/ud_rls.hpp"
#include "tests/ident/textbook_rls.hpp"
#include "tools/paper/table1.hpp"

// last: CppUTest redefines new
#include <CppUTest/TestHarness.h>

using wheelwright::ident::ArxRegressor;
using wheelwright::ident::Forgetting;
using wheelwright::ident::UdRls;
using wheelwright::paper::run_table1;
using wheelwright::test::BatchQr;
using wheelwright::test::TextbookRls;

namespace {

template <typename Real, typename Vector>
double worst_relative(const std::array<Real, 2>& theta, const Vector& truth) {
    double worst = 0;
    for (std::size_t i = 0; i < 2; ++i) {
        const double t = truth[static_cast<Eigen::Index>(i)];
        worst = std::max(worst, std::abs((static_cast<double>(theta[i]) - t) / t));
    }
    return worst;
}

// A million K5/K7 rows of the paper's experiment, noise included. `scale` multiplies K5's column and thereby
// the condition of the problem.
template <typename Visit>
void for_a_million_rows(double scale, Visit&& visit) {
    // the plant is simulated once for 100 000 samples and lived through ten times, with fresh noise on y
    const auto experiment = run_table1({.seed = 3, .samples = 100000, .keep_rows = true});
    std::mt19937_64 random(17);
    std::normal_distribution<double> normal;
    for (int pass = 0; pass < 10; ++pass)
        for (const auto& row : experiment.rows[0])
            visit(row.phi[0] * scale, row.phi[1], row.y + 0.5 * normal(random));
}

}  // namespace

TEST_GROUP(RecursiveLeastSquares){};

TEST(RecursiveLeastSquares, equals_batch_over_a_million_samples_in_double) {
    UdRls<double, 2> recursive;
    recursive.reset({0, 0}, {1e6, 1e6});
    BatchQr<2> batch;
    for_a_million_rows(1, [&](double a, double b, double y) {
        recursive.update({a, b}, y);
        batch.add(std::array<double, 2>{a, b}, y);
    });
    const auto solution = batch.solve();
    const auto sigma = batch.singular_values();
    const double prior = 1e6 * sigma[1] * sigma[1];
    const double worst = worst_relative(recursive.theta(), solution);
    const auto p = batch.covariance();
    const double worst_p = std::max(std::abs(recursive.variance(0) / p(0, 0) - 1),
                                    std::abs(recursive.variance(1) / p(1, 1) - 1));
    std::printf("\n  double: theta %.2e, P %.2e from batch; cond %.0f, c lambda_min %.1e\n", worst, worst_p,
                sigma[0] / sigma[1], prior);
    CHECK(prior >= 1e9);
    CHECK(worst < 1e-9);
    CHECK(worst_p < 1e-6);
}

TEST(RecursiveLeastSquares, in_float_stays_near_batch_where_the_textbook_form_fails) {
    for (const double wanted_condition : {30.0, 300.0, 2000.0}) {
        const double scale = wanted_condition / 24;
        UdRls<float, 2> recursive;
        recursive.reset({0, 0}, {1e6F, 1e6F});
        TextbookRls<float, 2> textbook;
        textbook.p *= 1e6F;
        BatchQr<2> batch;
        long lost_at = -1;
        long sample = 0;
        for_a_million_rows(scale, [&](double a, double b, double y) {
            const auto fa = static_cast<float>(a);
            const auto fb = static_cast<float>(b);
            const auto fy = static_cast<float>(y);
            recursive.update({fa, fb}, fy);
            textbook.update({fa, fb}, fy);
            if (lost_at < 0 && !textbook.positive()) lost_at = sample;
            batch.add(std::array<float, 2>{fa, fb}, static_cast<double>(fy));
            ++sample;
        });
        const auto solution = batch.solve();
        const auto sigma = batch.singular_values();
        const double worst = worst_relative(recursive.theta(), solution);
        const double textbook_worst =
            worst_relative(std::array<float, 2>{textbook.theta[0], textbook.theta[1]}, solution);
        std::printf("\n  float, cond %4.0f: U-D %.1e, textbook %.1e from batch, positive until sample %ld\n",
                    sigma[0] / sigma[1], worst, textbook_worst, lost_at);
        CHECK(sigma[0] / sigma[1] > 0.8 * wanted_condition);
        CHECK(worst < 1e-3);
        CHECK(recursive.variance(0) > 0 && recursive.variance(1) > 0);
        CHECK(lost_at >= 0 && lost_at < 100);
        // at 30 the textbook form limps on with a covariance that is no covariance; beyond, it is lost
        if (wanted_condition > 100) CHECK(!(textbook_worst < 0.1));
    }
}

namespace {

// Poles well inside the unit circle; the truth is the model's definition, paper eq (1).
template <int P, int Q>
void recover_arx(const std::array<double, P + Q>& truth) {
    ArxRegressor<double, P, Q> regressor;
    UdRls<double, P + Q> recursive;
    std::array<double, P + Q> prior{};
    prior.fill(1e8);
    recursive.reset({}, prior);
    BatchQr<P + Q> batch;
    wheelwright::ident::Prbs input({23, 18}, 5, 1);
    std::mt19937_64 random(11);
    std::normal_distribution<double> noise(0, 0.02);
    double y = 0;
    for (int t = 0; t < 200000; ++t) {
        regressor.push(y, input.next());
        const auto& phi = regressor.phi();
        y = noise(random);
        for (std::size_t i = 0; i < phi.size(); ++i) y += truth[i] * phi[i];
        if (!regressor.full()) continue;
        recursive.update(phi, y);
        batch.add(phi, y);
    }
    const auto solution = batch.solve();
    double from_batch = 0;
    double from_truth = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
        from_batch =
            std::max(from_batch, std::abs(recursive.theta()[i] / solution[static_cast<Eigen::Index>(i)] - 1));
        // noise is white, so sigma sqrt(P) is an honest deviation here
        from_truth = std::max(from_truth, std::abs(recursive.theta()[i] - truth[i]) /
                                              (0.02 * std::sqrt(recursive.variance(static_cast<int>(i)))));
    }
    std::printf("\n  ARX(%d,%d): %.1e from batch, %.1f standard errors from the truth\n", P, Q, from_batch,
                from_truth);
    CHECK(from_batch < 1e-9);
    CHECK(from_truth < 4);
}

}  // namespace

TEST(RecursiveLeastSquares, recovers_arx_models) {
    recover_arx<2, 2>({1.5, -0.7, 1.0, 0.5});
    recover_arx<4, 3>({1.1, -0.56, 0.21, -0.08, 0.8, -0.35, 0.15});
}

TEST_GROUP(ForgettingAndBounds) {
    // One regression of a robot that turns on the spot: K6's column is empty, K8's is excited. K8 drops by 24
    // %.
    static constexpr double kBefore = 6.74245;
    static constexpr double kAfter = kBefore / 1.3;
    static constexpr double kK6 = -1.2356;
    static constexpr int kBeforeSamples = 4000;
    static constexpr int kAfterSamples = 600;

    template <typename Update>
    static void spin(Update && update) {
        wheelwright::ident::Prbs torque({17, 14}, 9, 5);
        std::mt19937_64 random(4);
        std::normal_distribution<double> normal;
        for (int k = 0; k < kBeforeSamples + kAfterSamples; ++k) {
            const double tau = 2 * torque.next();
            update(0.0, tau, (k < kBeforeSamples ? kBefore : kAfter) * tau + 0.2 * normal(random));
        }
    }
};

TEST(ForgettingAndBounds, directional_follows_what_is_excited_and_keeps_the_rest) {
    UdRls<double, 2> rls;
    rls.reset({kK6, kBefore}, {0.01, 1.0});
    rls.set_forgetting(Forgetting::directional, 0.99);
    spin([&](double a, double b, double y) { rls.update({a, b}, y); });
    DOUBLES_EQUAL(kK6, rls.theta()[0], 0);
    DOUBLES_EQUAL(0.01, rls.variance(0), 1e-15);
    DOUBLES_EQUAL(kAfter, rls.theta()[1], 0.03);
}

TEST(ForgettingAndBounds, rows_that_tell_next_to_nothing_make_nothing_less_known) {
    UdRls<double, 2> rls;
    rls.reset({kK6, kBefore}, {0.01, 1.0});
    rls.set_forgetting(Forgetting::directional, 0.99);
    for (int k = 0; k < 100000; ++k) rls.update({1e-3 * (k % 2), 1e-3}, 0);
    CHECK(rls.variance(0) <= 0.01 && rls.variance(1) <= 1.0);
    spin([&](double a, double b, double y) { rls.update({a, b}, y); });
    CHECK(rls.variance(0) <= 0.01 && rls.variance(1) <= 1.0);
}

TEST(ForgettingAndBounds, exponential_forgetting_would_blow_up_what_is_not_excited) {
    UdRls<double, 2> rls;
    rls.reset({kK6, kBefore}, {0.01, 1.0});
    rls.set_forgetting(Forgetting::exponential, 0.99);
    spin([&](double a, double b, double y) { rls.update({a, b}, y); });
    CHECK(rls.variance(0) > 1e6);
    // bounded, it stays
    UdRls<double, 2> bounded;
    bounded.reset({kK6, kBefore}, {0.01, 1.0});
    bounded.set_forgetting(Forgetting::exponential, 0.99);
    bounded.set_bounds(0, 0, 0.04);
    bounded.set_bounds(1, 0, 4.0);
    spin([&](double a, double b, double y) { bounded.update({a, b}, y); });
    DOUBLES_EQUAL(0.04, bounded.variance(0), 1e-9);
    DOUBLES_EQUAL(kAfter, bounded.theta()[1], 0.03);
}

TEST(ForgettingAndBounds, trace_scaling_would_freeze_the_excited_parameter) {
    // constant trace: what the unexcited direction keeps, the excited one never gets back
    TextbookRls<double, 2> rls;
    rls.theta = {kK6, kBefore};
    rls.p.diagonal() << 1.0, 1.0;
    const double trace = rls.p.trace();
    spin([&](double a, double b, double y) {
        rls.update({a, b}, y);
        rls.p *= trace / rls.p.trace();
    });
    const double off = rls.theta[1] / kAfter - 1;
    std::printf("\n  trace scaling: K8 %.0f %% off after the change\n", 100 * off);
    CHECK(off > 0.2);
}

TEST(ForgettingAndBounds, covariance_stays_positive_and_bounded_in_float_for_ever) {
    UdRls<float, 2> rls;
    rls.reset({0, 0}, {100.0F, 100.0F});
    rls.set_forgetting(Forgetting::directional, 0.98F);
    rls.set_bounds(0, 1e-6F, 100.0F);
    rls.set_bounds(1, 1e-6F, 100.0F);
    std::mt19937 random(8);
    std::normal_distribution<float> normal;
    for (int k = 0; k < 1000000; ++k) {
        // mostly one direction, sometimes tiny, sometimes nothing
        const float size = k % 7 == 0 ? 0.0F : k % 11 == 0 ? 1e-12F : 10.0F;
        const std::array<float, 2> phi{size * (1 + 0.001F * normal(random)), 0.5F * size};
        rls.update(phi, phi[0] * 3 - phi[1] + normal(random));
        for (int i = 0; i < 2; ++i) {
            CHECK(rls.variance(i) >= 1e-6F * 0.999F);
            CHECK(rls.variance(i) <= 100.0F * 1.001F);
        }
    }
    const double determinant = static_cast<double>(rls.variance(0)) * rls.variance(1) -
                               std::pow(static_cast<double>(rls.covariance(0, 1)), 2);
    CHECK(determinant > 0);
}

TEST(ForgettingAndBounds, added_variance_lands_on_one_parameter_only) {
    UdRls<double, 3> rls;
    rls.reset({1, 2, 3}, {4, 5, 6});
    rls.update({1, -2, 0.5}, 0.3);
    rls.update({0.3, 1, 1}, -2);
    double before[3][3];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) before[i][j] = rls.covariance(i, j);
    rls.add_variance(1, 0.7);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            DOUBLES_EQUAL(before[i][j] + (i == 1 && j == 1 ? 0.7 : 0), rls.covariance(i, j), 1e-12);
}
