// Runs one of several loops, for an instruction counter to compare: estimator_cost WHAT STEPS.
//   nothing    only the data
//   ours       both regressions, forgetting, bounds and the model guard
//   paper      the same equations with dynamically sized matrices, as in the paper's Listing 4
//   adaptive   a whole cycle of filter and adaptive estimator
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include <Eigen/Dense>

#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/model_guard.hpp"

namespace {

using namespace wheelwright;

// Something that varies, cheaply.
struct Data {
    double v, omega, sum, difference;
    explicit Data(int k)
        : v(k * 104729 % 1000 * 1e-3 - 0.5),
          omega(k * 7919 % 1000 * 1e-2 - 5),
          sum(k * 31 % 17 - 8),
          difference(k * 13 % 11 - 5) {}
    double y1() const { return 0.04 * omega * omega + 1.4 * sum; }
    double y2() const { return -1.2 * v * omega + 6.7 * difference; }
};

double nothing(int steps) {
    double sum = 0;
    for (int k = 0; k < steps; ++k) {
        const Data d(k);
        sum += d.y1() + d.y2();
    }
    return sum;
}

double ours(int steps) {
    ident::UdRls<double, 2> linear;
    ident::UdRls<double, 2> turning;
    for (auto* rls : {&linear, &turning}) {
        rls->reset({0, 0}, {1e3, 1e3});
        rls->set_forgetting(ident::Forgetting::directional, 0.995);
        rls->set_bounds(0, 1e-9, 1e6);
        rls->set_bounds(1, 1e-9, 1e6);
    }
    ident::ModelGuard<double> guard;
    guard.configure({0.1, 0.5, 0.05, 3, 0.001, 0.32}, {0.04, -1.2, 1.4, 6.7}, {});
    ident::DynamicsEstimate<double> estimate;
    for (int k = 0; k < steps; ++k) {
        const Data d(k);
        linear.update({d.omega * d.omega, d.sum}, d.y1());
        turning.update({d.v * d.omega, d.difference}, d.y2());
        estimate.dynamics = {linear.theta()[0], turning.theta()[0], linear.theta()[1], turning.theta()[1]};
        guard.update(estimate, true);
    }
    return guard.dynamics().k7_per_kg_m + linear.theta()[1];
}

double paper(int steps) {
    using Eigen::MatrixXd;
    using Eigen::VectorXd;
    const int n = 2;
    VectorXd theta1 = VectorXd::Zero(n);
    VectorXd theta2 = VectorXd::Zero(n);
    MatrixXd p1 = MatrixXd::Identity(n, n) * 1e3;
    MatrixXd p2 = p1;
    for (int k = 0; k < steps; ++k) {
        const Data d(k);
        VectorXd y(n);
        y << d.y1(), d.y2();
        VectorXd phi1(n);
        VectorXd phi2(n);
        phi1 << d.omega * d.omega, d.sum;
        phi2 << d.v * d.omega, d.difference;
        const double predicted1 = phi1.transpose() * theta1;
        const VectorXd gain1 = p1 * phi1 / (1 + phi1.transpose() * p1 * phi1);
        theta1 += gain1 * (y[0] - predicted1);
        p1 -= gain1 * phi1.transpose() * p1;
        const double predicted2 = phi2.transpose() * theta2;
        const VectorXd gain2 = p2 * phi2 / (1 + phi2.transpose() * p2 * phi2);
        theta2 += gain2 * (y[1] - predicted2);
        p2 -= gain2 * phi2.transpose() * p2;
    }
    return theta1[1] + theta2[1];
}

double adaptive(int steps) {
    ident::AdaptiveEstimatorOptions<double> options;
    options.filter.geometry = {{0.075, 0.075}, 0.32};
    for (const char* name : {"viscous_friction", "coulomb_friction"}) {
        options.filter.effects.active[model::find_effect(name)] = true;
    }
    options.filter.sample_time_s = 0.001;
    options.filter.kernel_s = 0.05;
    options.filter.delay_s = 0.0027;
    options.dynamics = {0.04, 0, 1.4, 6.7};
    options.effects = options.filter.effects;
    ident::AdaptiveEstimator<double> estimator;
    estimator.configure(options);
    for (int k = 0; k < steps; ++k) {
        const Data d(k);
        const double t = k * 1e-3;
        estimator.push({{10 * t + 0.3 * t * t, 9 * t + 0.2 * t * t}, {d.v, d.omega}});
    }
    return estimator.estimate().dynamics.k7_per_kg_m;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) return 1;
    const std::string_view what = argv[1];
    const int steps = std::atoi(argv[2]);
    double result = 0;
    if (what == "nothing") result = nothing(steps);
    if (what == "ours") result = ours(steps);
    if (what == "paper") result = paper(steps);
    if (what == "adaptive") result = adaptive(steps);
    std::printf("%g\n", result);
    return 0;
}
