#include "tools/paper/table1.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "firmware/ident/coloured_errors.hpp"
#include "firmware/ident/prbs.hpp"
#include "firmware/ident/ud_rls.hpp"

namespace wheelwright::paper {
namespace {

using Pair = std::array<double, 2>;

constexpr double kSample_s = 0.01;
constexpr double kAmplitude_Nm = 5;
constexpr Pair kLimit{3, 20};
// What one sample of full torque and of the velocity terms can add.
constexpr Pair kTorqueStep{1.88, 1.45};
constexpr Pair kDriftStep{0.04, 0.15};

Pair derivative(const Pair& u, const Pair& torque) {
    const auto& k = kTable1Truth;
    return {k[0] * u[1] * u[1] + k[2] * (torque[0] + torque[1]),
            k[1] * u[0] * u[1] + k[3] * (torque[0] - torque[1])};
}

Pair integrate(Pair u, const Pair& torque) {
    constexpr int kSteps = 10;
    constexpr double h = kSample_s / kSteps;
    const auto along = [](const Pair& a, const Pair& d, double f) {
        return Pair{a[0] + f * d[0], a[1] + f * d[1]};
    };
    for (int i = 0; i < kSteps; ++i) {
        const Pair a = derivative(u, torque);
        const Pair b = derivative(along(u, a, h / 2), torque);
        const Pair c = derivative(along(u, b, h / 2), torque);
        const Pair d = derivative(along(u, c, h), torque);
        for (std::size_t j = 0; j < 2; ++j) u[j] += h / 6 * (a[j] + 2 * b[j] + 2 * c[j] + d[j]);
    }
    return u;
}

// Keeps |u| within kLimit by replacing a torque that would carry it over. True when it did.
bool override_torque(const Pair& u, Pair& torque) {
    const auto toward_limit = [&](std::size_t i, double push) {
        const double size = std::abs(u[i]);
        return size > kLimit[i] - 2 * kDriftStep[i] ||
               (push * u[i] > 0 && size > kLimit[i] - kTorqueStep[i] - 2 * kDriftStep[i]);
    };
    const double sign_of_k8 = std::copysign(1.0, kTable1Truth[3]);
    if (toward_limit(0, torque[0] + torque[1])) {
        const double back = u[0] > 0 ? -kAmplitude_Nm : kAmplitude_Nm;
        torque = {back, back};
        return true;
    }
    if (toward_limit(1, sign_of_k8 * (torque[0] - torque[1]))) {
        const double back = (u[1] > 0 ? -kAmplitude_Nm : kAmplitude_Nm) * sign_of_k8;
        torque = {back, -back};
        return true;
    }
    return false;
}

struct Regression {
    ident::UdRls<double, 2> rls;
    ident::ColouredErrors<double, 2> errors;
};

// Rows of eq (46) and (49) for the step from x to y.
std::array<Table1Row, 2> rows_of(const Pair& x, const Pair& y, const Pair& torque, Table1Regression kind) {
    double square = x[1] * x[1];
    double product = x[0] * x[1];
    if (kind == Table1Regression::step_averaged) {
        square = (x[1] * x[1] + x[1] * y[1] + y[1] * y[1]) / 3;
        product = (2 * x[0] * x[1] + x[0] * y[1] + y[0] * x[1] + 2 * y[0] * y[1]) / 6;
    }
    return {{{{square, torque[0] + torque[1]}, (y[0] - x[0]) / kSample_s},
             {{product, torque[0] - torque[1]}, (y[1] - x[1]) / kSample_s}}};
}

template <typename Values>
void interleave(std::array<double, 4>& out, const Values& value) {
    for (std::size_t e = 0; e < 2; ++e)
        for (std::size_t i = 0; i < 2; ++i) out[2 * i + e] = value(e, i);
}

}  // namespace

Table1Result run_table1(const Table1Options& options) {
    std::mt19937_64 random(options.seed);
    std::normal_distribution<double> normal;
    ident::Prbs first(ident::kPrbsLeft, options.seed, 1);
    ident::Prbs second(ident::kPrbsRight, options.seed, 1);
    std::array<Regression, 2> regression;
    for (Regression& r : regression) {
        r.rls.reset({0, 0}, {kTable1Prior, kTable1Prior});
        r.errors.reset(1);
    }

    Table1Result result;
    Pair u{};
    Pair measured{options.speed_noise * normal(random), options.speed_noise * normal(random)};
    for (std::size_t k = 0; k < options.samples; ++k) {
        Pair torque{kAmplitude_Nm * first.next(), kAmplitude_Nm * second.next()};
        if (override_torque(measured, torque)) ++result.overridden_samples;
        u = integrate(u, {torque[0] + options.torque_noise_Nm * normal(random),
                          torque[1] + options.torque_noise_Nm * normal(random)});
        const Pair before = measured;
        measured = {u[0] + options.speed_noise * normal(random), u[1] + options.speed_noise * normal(random)};
        const auto rows = rows_of(before, measured, torque, options.regression);
        for (std::size_t e = 0; e < 2; ++e) {
            Regression& r = regression[e];
            r.errors.push(rows[e].phi, r.rls.update(rows[e].phi, rows[e].y));
            result.torque_power[e] += rows[e].phi[1] * rows[e].phi[1];
            result.largest_speed[e] = std::max(result.largest_speed[e], std::abs(u[e]));
            if (options.keep_rows) result.rows[e].push_back(rows[e]);
        }
        if (options.series_stride > 0 && k % options.series_stride == 0) {
            Table1Point point{static_cast<double>(k + 1) * kSample_s, {}, {}};
            interleave(point.estimate,
                       [&](std::size_t e, std::size_t i) { return regression[e].rls.theta()[i]; });
            interleave(point.covariance_diagonal, [&](std::size_t e, std::size_t i) {
                return regression[e].rls.variance(static_cast<int>(i));
            });
            result.series.push_back(point);
        }
    }

    interleave(result.estimate, [&](std::size_t e, std::size_t i) { return regression[e].rls.theta()[i]; });
    interleave(result.covariance_diagonal,
               [&](std::size_t e, std::size_t i) { return regression[e].rls.variance(static_cast<int>(i)); });
    interleave(result.naive_standard_error, [&](std::size_t e, std::size_t i) {
        const Regression& r = regression[e];
        return std::sqrt(r.errors.residual_variance() * r.rls.variance(static_cast<int>(i)));
    });
    interleave(result.standard_error, [&](std::size_t e, std::size_t i) {
        const Regression& r = regression[e];
        const int row = static_cast<int>(i);
        const Pair p{r.rls.covariance(row, 0), r.rls.covariance(row, 1)};
        return std::sqrt(r.errors.covariance(r.errors.noise_variances(), p, p));
    });
    return result;
}

}  // namespace wheelwright::paper
