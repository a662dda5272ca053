// Batch least squares of logs: standard errors that cover, and columns the data cannot tell.
#include <Eigen/Core>
#include <cmath>
#include <cstdio>
#include <random>

#include "tests/support/seeds.hpp"
#include "tools/ident/regression.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

// y = 2 x1 - 3 x2 + noise that is the difference of white noise, plus a slow first-order drift.
tools::Rows coloured_rows(unsigned seed, Eigen::Index count, double difference, double drift) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    tools::Rows rows;
    rows.phi.resize(count, 2);
    rows.y.resize(count);
    double slow = 0;
    double before = normal(random);
    double x = 0;
    for (Eigen::Index t = 0; t < count; ++t) {
        x = 0.9 * x + normal(random);
        rows.phi(t, 0) = x;
        rows.phi(t, 1) = normal(random);
        slow = 0.9 * slow + normal(random);
        const double now = normal(random);
        rows.y(t) = 2 * x - 3 * rows.phi(t, 1) + difference * (now - before) + drift * slow;
        before = now;
        rows.place.push_back(static_cast<std::size_t>(t));
    }
    return rows;
}

double covered_percent(double difference, double drift) {
    int inside = 0;
    constexpr int kSeeds = wheelwright::test::seeds(200);
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        const tools::Fit fit = tools::least_squares(coloured_rows(seed, 800, difference, drift));
        inside += std::abs(fit.theta(0) - 2) < 1.96 * std::sqrt(fit.covariance(0, 0)) ? 1 : 0;
        inside += std::abs(fit.theta(1) + 3) < 1.96 * std::sqrt(fit.covariance(1, 1)) ? 1 : 0;
    }
    return 100.0 * inside / (2 * kSeeds);
}

}  // namespace

TEST_GROUP(LogRegression){};

TEST(LogRegression, IntervalsCoverWhateverTheColour) {
    const double white = covered_percent(0, 0.0001);
    const double differenced = covered_percent(1, 0);
    const double drifting = covered_percent(0, 0.5);
    const double both = covered_percent(1, 0.5);
    std::printf(
        "  95 %% intervals cover %.1f %% (drift), %.1f %% (differenced), %.1f %% (drifting), %.1f %% "
        "(both)\n",
        white, differenced, drifting, both);
    for (const double covered : {white, differenced, drifting, both}) {
        CHECK(covered > (wheelwright::test::all_seeds() ? 88 : 70));
        CHECK(covered <= 100);
    }
}

TEST(LogRegression, ColumnsThatAreTheSameAreToldAsUnknown) {
    tools::Rows rows = coloured_rows(3, 300, 0, 0);
    rows.phi.conservativeResize(Eigen::NoChange, 5);
    rows.phi.col(2).setZero();
    rows.phi.col(3) = 2 * rows.phi.col(1);
    rows.phi.col(4) = rows.phi.col(0).cwiseAbs2();
    const tools::Fit fit = tools::least_squares(rows);
    CHECK(fit.tells(0));
    CHECK_FALSE(fit.tells(1));
    CHECK_FALSE(fit.tells(2));
    CHECK_FALSE(fit.tells(3));
    CHECK(fit.tells(4));
    DOUBLES_EQUAL(2, fit.theta(0), 1e-9);
    DOUBLES_EQUAL(-3, fit.theta(1) + 2 * fit.theta(3), 1e-9);  // only the sum is known
    DOUBLES_EQUAL(0, fit.theta(2), 0);
}

TEST(LogRegression, WhiteningFindsWhatDifferencingHid) {
    double plain = 0;
    double white = 0;
    for (unsigned seed = 1; seed <= 30; ++seed) {
        const tools::Rows rows = coloured_rows(seed, 600, 1, 0);
        plain += std::pow(tools::least_squares(rows).theta(0) - 2, 2);
        white += std::pow(tools::least_squares(tools::whiten(rows, 0.97)).theta(0) - 2, 2);
    }
    std::printf("  rms error of a slow column: %.4f plain, %.4f whitened\n", std::sqrt(plain / 30),
                std::sqrt(white / 30));
    CHECK(white < plain / 2);
}
