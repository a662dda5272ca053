#include <cmath>
#include <cstdio>
#include <vector>

#include <Eigen/Dense>

#include "tests/ident/textbook_rls.hpp"
#include "tools/paper/table1.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::paper;

namespace {

constexpr const char* kNames[] = {"K5", "K6", "K7", "K8"};
constexpr double kTolerance[] = {0.01, 0.01, 0.001, 0.001};

}  // namespace

TEST_GROUP(Table1){};

TEST(Table1, without_noise_the_parameters_of_plant_60_come_back) {
    const Table1Result plain = run_table1({.regression = Table1Regression::plain});
    const Table1Result averaged = run_table1({});
    std::printf("\n        truth      step-averaged        plain (44)           P_ii        paper's P_ii\n");
    for (std::size_t i = 0; i < 4; ++i) {
        const double truth = kTable1Truth[i];
        std::printf("  %s %9.5f %11.6f %+8.4f%% %11.6f %+8.3f%%  %.4e  %.4e\n", kNames[i], truth,
                    averaged.estimate[i], 100 * (averaged.estimate[i] / truth - 1), plain.estimate[i],
                    100 * (plain.estimate[i] / truth - 1), averaged.covariance_diagonal[i],
                    kTable1PaperCovariance[i]);
        CHECK(std::abs(averaged.estimate[i] / truth - 1) < kTolerance[i]);
    }
    CHECK(averaged.largest_speed[0] < 3);
    CHECK(averaged.largest_speed[1] < 20);
}

TEST(Table1, covariance_is_that_of_the_torques_and_of_the_batch_solution) {
    const Table1Result result = run_table1({.keep_rows = true});
    for (std::size_t e = 0; e < 2; ++e) {
        const double from_power = result.covariance_diagonal[2 + e] * result.torque_power[e] - 1;
        wheelwright::test::BatchQr<2> batch;
        for (const Table1Row& row : result.rows[e]) batch.add(row.phi, row.y);
        const auto p = batch.covariance();
        const auto theta = batch.solve();
        std::printf("\n  %s: P sum(phi^2) - 1 = %.1e; from batch: P %.1e, theta %.1e\n", kNames[2 + e],
                    from_power, result.covariance_diagonal[2 + e] / p(1, 1) - 1,
                    result.estimate[2 + e] / theta[1] - 1);
        CHECK(std::abs(from_power) < 1e-3);
        CHECK(std::abs(result.covariance_diagonal[2 + e] / p(1, 1) - 1) < 1e-6);
        CHECK(std::abs(result.covariance_diagonal[e] / p(0, 0) - 1) < 1e-6);
        CHECK(std::abs(result.estimate[2 + e] / theta[1] - 1) < 1e-6);
        // the paper's own diagonal, whose sequences are not known: same length of experiment
        CHECK(std::abs(result.covariance_diagonal[2 + e] / kTable1PaperCovariance[2 + e] - 1) < 0.05);
    }
}

TEST(Table1, intervals_are_honest_under_noise) {
    constexpr int kSeeds = 100;
    double mean[4]{};
    double square[4]{};
    double naive[4]{};
    int covered[4]{};
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        const Table1Result r = run_table1({.seed = seed, .speed_noise = 0.01, .torque_noise_Nm = 0.05});
        for (std::size_t i = 0; i < 4; ++i) {
            const double error = r.estimate[i] - kTable1Truth[i];
            const double z = error / r.standard_error[i];
            mean[i] += z / kSeeds;
            square[i] += z * z / kSeeds;
            naive[i] += std::pow(error / r.naive_standard_error[i], 2) / kSeeds;
            covered[i] += std::abs(z) < 1.96 ? 1 : 0;
        }
    }
    std::printf("\n  noise: 0.01 on u, 0.05 Nm of unknown torque; %d seeds\n", kSeeds);
    for (std::size_t i = 0; i < 4; ++i) {
        std::printf("  %s mean z %+.2f, rms z %.2f (naive %.2f), 95 %% interval covers %d %%\n", kNames[i],
                    mean[i], std::sqrt(square[i]), std::sqrt(naive[i]), covered[i]);
        CHECK(std::abs(mean[i]) < 0.3);
        CHECK(std::sqrt(square[i]) > 0.8 && std::sqrt(square[i]) < 1.25);
        CHECK(covered[i] >= 88 && covered[i] <= 99);
    }
}

// Why coloured_errors.hpp does not use a lag window: the Bartlett window (Newey and West 1987) leaks power
// into the null at frequency zero that differencing makes.
TEST(Table1, a_lag_window_would_be_far_too_careful_about_slow_regressors) {
    constexpr int kSeeds = 20;
    constexpr std::size_t kLags = 8;
    double ours = 0;
    double window = 0;
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        const Table1Result r = run_table1({.seed = seed, .speed_noise = 0.01, .keep_rows = true});
        const auto& rows = r.rows[0];
        wheelwright::test::BatchQr<2> batch;
        for (const Table1Row& row : rows) batch.add(row.phi, row.y);
        const Eigen::Vector2d theta = batch.solve();
        std::vector<Eigen::Vector2d> score;
        for (const Table1Row& row : rows) {
            const Eigen::Vector2d phi(row.phi[0], row.phi[1]);
            score.emplace_back(phi * (row.y - phi.dot(theta)));
        }
        Eigen::Matrix2d middle = Eigen::Matrix2d::Zero();
        for (std::size_t t = 0; t < score.size(); ++t) {
            middle += score[t] * score[t].transpose();
            for (std::size_t lag = 1; lag <= std::min(kLags, t); ++lag) {
                const double weight = 1 - static_cast<double>(lag) / (kLags + 1);
                middle +=
                    weight * (score[t] * score[t - lag].transpose() + score[t - lag] * score[t].transpose());
            }
        }
        const Eigen::Matrix2d p = batch.covariance();
        const double error = r.estimate[0] - kTable1Truth[0];
        ours += std::pow(error / r.standard_error[0], 2) / kSeeds;
        window += error * error / (p * middle * p)(0, 0) / kSeeds;
    }
    std::printf("\n  K5, sensor noise only: rms z %.2f, with a Bartlett window of 8 lags %.2f\n",
                std::sqrt(ours), std::sqrt(window));
    CHECK(std::sqrt(window) < 0.4);
    CHECK(std::sqrt(ours) > 0.6 && std::sqrt(ours) < 1.4);
}

TEST(Table1, the_same_seed_gives_the_same_numbers) {
    const Table1Result a = run_table1({.seed = 7, .samples = 500, .speed_noise = 0.01, .series_stride = 100});
    const Table1Result b = run_table1({.seed = 7, .samples = 500, .speed_noise = 0.01, .series_stride = 100});
    CHECK(a.estimate == b.estimate);
    LONGS_EQUAL(5, a.series.size());
    CHECK(a.series[3].estimate == b.series[3].estimate);
}
