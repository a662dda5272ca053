#include "tools/paper/model_experiments.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "firmware/control/feedback_linearisation.hpp"
#include "firmware/ident/arx.hpp"
#include "firmware/ident/prbs.hpp"
#include "firmware/ident/ud_rls.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "sim_hal/plant.hpp"
#include "sim_hal/random.hpp"
#include "tools/paper/table1.hpp"

namespace wheelwright::paper {
namespace {

constexpr double kPrior = 1e6;

template <int kOutputs, int kInputs>
ArxResult run_arx(const std::array<double, kOutputs + kInputs>& truth, std::size_t samples) {
    constexpr int kSize = kOutputs + kInputs;
    using Vector = std::array<double, kSize>;
    ArxResult result;
    result.truth.assign(truth.begin(), truth.end());
    for (const double deviation : {0.0, 0.05}) {
        ident::ArxRegressor<double, kOutputs, kInputs> regressor;
        ident::UdRls<double, kSize> rls;
        Vector prior;
        prior.fill(kPrior);
        rls.reset(Vector{}, prior);
        ident::Prbs input(ident::kPrbsLeft, 7, 1);
        sim::Random random(11);
        Eigen::MatrixXd rows(static_cast<Eigen::Index>(samples), kSize);
        Eigen::VectorXd outputs(static_cast<Eigen::Index>(samples));
        double y = 0;
        double power = 0;
        for (std::size_t n = 0; n < samples; ++n) {
            regressor.push(y, input.next());
            double next = deviation * random.gaussian();
            for (std::size_t i = 0; i < kSize; ++i) next += truth[i] * regressor.phi()[i];
            const double innovation = rls.update(regressor.phi(), next);
            power += innovation * innovation;
            const auto row = static_cast<Eigen::Index>(n);
            for (std::size_t i = 0; i < kSize; ++i)
                rows(row, static_cast<Eigen::Index>(i)) = regressor.phi()[i];
            outputs(row) = next;
            y = next;
        }
        if (deviation == 0.0) {
            for (std::size_t i = 0; i < kSize; ++i)
                result.noise_free_error =
                    std::max(result.noise_free_error, std::abs(rls.theta()[i] - truth[i]));
            continue;
        }
        // The recursive estimate has a prior; so has the batch, as further rows.
        Eigen::MatrixXd all(rows.rows() + kSize, kSize);
        all << rows, Eigen::MatrixXd::Identity(kSize, kSize) / std::sqrt(kPrior);
        Eigen::VectorXd right(outputs.size() + kSize);
        right << outputs, Eigen::VectorXd::Zero(kSize);
        const Eigen::VectorXd batch = all.householderQr().solve(right);
        const double variance = power / static_cast<double>(samples);
        for (std::size_t i = 0; i < kSize; ++i) {
            result.recursive.push_back(rls.theta()[i]);
            result.standard_error.push_back(std::sqrt(variance * rls.variance(static_cast<int>(i))));
            const double exact = batch(static_cast<Eigen::Index>(i));
            result.batch_difference =
                std::max(result.batch_difference, std::abs((rls.theta()[i] - exact) / exact));
        }
    }
    return result;
}

}  // namespace

ArxResult run_arx_2_2(std::size_t samples) {
    // poles 0.8 +- 0.35 j, a zero outside the unit circle
    return run_arx<2, 2>({1.6, -0.7625, 0.4, -0.55}, samples);
}

ArxResult run_arx_4_3(std::size_t samples) {
    // poles 0.7 +- 0.5 j, -0.6 and 0.45
    return run_arx<4, 3>({1.25, -0.26, -0.489, 0.1998, 0.7, 0.31, -0.12}, samples);
}

PrecisionResult run_precision(std::size_t samples) {
    const std::vector<Table1Row> rows =
        run_table1({.seed = 3, .samples = samples, .keep_rows = true}).rows[0];
    ident::UdRls<float, 2> ours;
    ours.reset({0, 0}, {1e6F, 1e6F});
    std::array<float, 2> theta{};
    std::array<std::array<float, 2>, 2> p{{{1e6F, 0}, {0, 1e6F}}};
    // the information form in double serves as the batch solution
    Eigen::Matrix2d normal = Eigen::Matrix2d::Identity() / kPrior;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    sim::Random random(5);
    PrecisionResult result;
    for (std::size_t n = 0; n < rows.size(); ++n) {
        const std::array<float, 2> phi{static_cast<float>(rows[n].phi[0]),
                                       static_cast<float>(rows[n].phi[1])};
        const auto y = static_cast<float>(rows[n].y + 0.5 * random.gaussian());
        ours.update(phi, y);
        // eq (33)-(35) as printed
        const std::array<float, 2> pf{p[0][0] * phi[0] + p[0][1] * phi[1],
                                      p[1][0] * phi[0] + p[1][1] * phi[1]};
        const float scale = 1 + phi[0] * pf[0] + phi[1] * pf[1];
        const std::array<float, 2> k{pf[0] / scale, pf[1] / scale};
        const float error = y - (phi[0] * theta[0] + phi[1] * theta[1]);
        theta = {theta[0] + k[0] * error, theta[1] + k[1] * error};
        const std::array<float, 2> fp{phi[0] * p[0][0] + phi[1] * p[1][0],
                                      phi[0] * p[0][1] + phi[1] * p[1][1]};
        for (std::size_t i = 0; i < 2; ++i)
            for (std::size_t j = 0; j < 2; ++j) p[i][j] -= k[i] * fp[j];
        const bool negative = p[0][0] < 0 || p[1][1] < 0 || p[0][0] * p[1][1] < p[0][1] * p[1][0];
        if (result.textbook_negative_after == 0 && negative) result.textbook_negative_after = n + 1;
        const Eigen::Vector2d exact(phi[0], phi[1]);
        normal += exact * exact.transpose();
        moment += exact * static_cast<double>(y);
    }
    const Eigen::Vector2d batch = normal.ldlt().solve(moment);
    for (std::size_t i = 0; i < 2; ++i) {
        const double truth = batch(static_cast<Eigen::Index>(i));
        const auto off = [truth](float value) { return std::abs(static_cast<double>(value) / truth - 1); };
        result.factorised = std::max(result.factorised, off(ours.theta()[i]));
        result.textbook = std::max(result.textbook, off(theta[i]));
    }
    return result;
}

CascadeResult run_cascade(double duration_s) {
    const model::Geometry<double> geometry{{0.0753, 0.0753}, 0.3217};
    const model::Dynamics<double> k{0.0413, model::coupled_k6(0.0413, 1.40855, 6.74245, 0.3217), 1.40855,
                                    6.74245};
    sim::Plant plant(sim::plant_from_dynamics(geometry, k, {}));
    using State = std::array<double, 5>;  // v, omega, x, y, heading
    State state{};
    const auto slope = [&k](const State& s, double right, double left) -> State {
        return {k.k5_m * s[1] * s[1] + k.k7_per_kg_m * (right + left),
                k.k6_per_m * s[0] * s[1] + k.k8_per_kg_m2 * (right - left), s[0] * std::cos(s[4]),
                s[0] * std::sin(s[4]), s[1]};
    };
    const auto moved = [](const State& s, const State& by, double h) {
        State to;
        for (std::size_t i = 0; i < to.size(); ++i) to[i] = s[i] + h * by[i];
        return to;
    };
    constexpr double kStep_s = 0.0005;
    const auto steps = static_cast<std::size_t>(duration_s / kStep_s);
    CascadeResult result;
    for (std::size_t n = 0; n < steps; ++n) {
        const double t = static_cast<double>(n) * kStep_s;
        const double together = 0.21 * std::sin(2.3 * t) + 0.05;
        const double apart = 0.11 * std::sin(1.1 * t + 0.4);
        const double right = together + apart - 0.3 * state[0];  // a brake keeps the speed in reason
        const double left = together - apart - 0.3 * state[0];
        const State k1 = slope(state, right, left);
        const State k2 = slope(moved(state, k1, kStep_s / 2), right, left);
        const State k3 = slope(moved(state, k2, kStep_s / 2), right, left);
        const State k4 = slope(moved(state, k3, kStep_s), right, left);
        for (std::size_t i = 0; i < state.size(); ++i)
            state[i] += kStep_s / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
        plant.advance(kStep_s, {left, right});
        result.path_m += std::abs(state[0]) * kStep_s;
        const auto worst = [](double& into, double difference) {
            into = std::max(into, std::abs(difference));
        };
        worst(result.v_m_per_s, plant.twist().v_m_per_s - state[0]);
        worst(result.omega_rad_per_s, plant.twist().omega_rad_per_s - state[1]);
        worst(result.position_m, std::hypot(plant.pose().x_m - state[2], plant.pose().y_m - state[3]));
        worst(result.heading_rad, plant.pose().heading_rad - state[4]);
    }
    return result;
}

double run_linearisation(std::size_t states) {
    control::PlantModel<double> plant;
    plant.geometry = {{0.0753, 0.0753}, 0.3217};
    plant.dynamics = {0.0413, model::coupled_k6(0.0413, 1.40855, 6.74245, 0.3217), 1.40855, 6.74245};
    const std::size_t viscous = model::find_effect("viscous_friction");
    const std::size_t coulomb = model::find_effect("coulomb_friction");
    plant.effects.active[viscous] = plant.effects.active[coulomb] = true;
    plant.effects.parameter[viscous][0] = 0.011;
    plant.effects.parameter[viscous][1] = 0.013;
    plant.effects.parameter[coulomb][0] = 0.31;
    plant.effects.parameter[coulomb][1] = 0.28;
    sim::Random random(3);
    double worst = 0;
    for (std::size_t n = 0; n < states; ++n) {
        // both wheels turn forward: there the friction has one sign
        const Twist<double> u{0.5 + 1.5 * random.uniform(), 2 * random.uniform() - 1};
        const TwistRate<double> wanted{4 * random.uniform() - 2, 20 * random.uniform() - 10};
        model::Motion<double> motion;
        motion.twist = u;
        motion.wheel_speed_rad_per_s = model::wheel_speeds_from_twist(plant.geometry, u);
        const WheelPair<double> torque = control::linearising_torque_Nm(plant, motion, u, wanted);
        sim::Plant robot(sim::plant_from_dynamics(plant.geometry, plant.dynamics, plant.effects));
        robot.place({}, u);
        constexpr double kMoment_s = 1e-7;
        robot.advance(kMoment_s, torque);
        worst = std::max(
            {worst, std::abs((robot.twist().v_m_per_s - u.v_m_per_s) / kMoment_s - wanted.v_m_per_s2) / 2,
             std::abs((robot.twist().omega_rad_per_s - u.omega_rad_per_s) / kMoment_s -
                      wanted.omega_rad_per_s2) /
                 10});
    }
    return worst;
}

ArmResult run_arm(double duration_s) {
    constexpr double kInertia = 0.0837;
    constexpr double kGravity_Nm = 1.93;
    constexpr double kFriction = 0.142;
    ArmResult result;
    result.truth = {1 / kInertia, kGravity_Nm / kInertia, kFriction / kInertia};
    ident::UdRls<double, 3> rls;
    rls.reset({}, {kPrior, kPrior, kPrior});
    ident::Prbs input(ident::kPrbsRight, 21, 4);
    constexpr double kSample_s = 0.01;
    constexpr int kSubsteps = 50;
    double q = 0.3;
    double rate = 0;
    const auto samples = static_cast<std::size_t>(duration_s / kSample_s);
    for (std::size_t n = 0; n < samples; ++n) {
        const double torque = 1.2 * input.next();
        const double before = rate;
        // regressors averaged over the step, as the estimator of the wheels has them
        double sine = 0;
        double mean_rate = 0;
        for (int i = 0; i < kSubsteps; ++i) {
            constexpr double kStep_s = kSample_s / kSubsteps;
            const auto acceleration = [&](double angle, double speed) {
                return (torque - kGravity_Nm * std::sin(angle) - kFriction * speed) / kInertia;
            };
            const double middle_rate = rate + kStep_s / 2 * acceleration(q, rate);
            const double middle = q + kStep_s / 2 * rate;
            rate += kStep_s * acceleration(middle, middle_rate);
            q += kStep_s * middle_rate;
            sine += std::sin(middle) / kSubsteps;
            mean_rate += middle_rate / kSubsteps;
        }
        rls.update({torque, -sine, -mean_rate}, (rate - before) / kSample_s);
    }
    for (std::size_t i = 0; i < 3; ++i) {
        result.estimate[i] = rls.theta()[i];
        result.largest_relative_error =
            std::max(result.largest_relative_error, std::abs(result.estimate[i] / result.truth[i] - 1));
    }
    return result;
}

}  // namespace wheelwright::paper
