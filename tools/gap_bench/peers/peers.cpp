#include "tools/gap_bench/peers/peers.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace wheelwright::peers {

std::vector<Eigen::Index> moving_steps(const ForwardRun& run, double threshold_rad_per_s) {
    std::vector<Eigen::Index> steps;
    const Eigen::VectorXd& speed = run.speed_rad_per_s;
    for (Eigen::Index k = 0; k + 1 < speed.size(); ++k) {
        if (std::min(std::abs(speed(k)), std::abs(speed(k + 1))) > threshold_rad_per_s) steps.push_back(k);
    }
    return steps;
}

OneStepLaw torque_alone(std::span<const ForwardRun> runs) {
    double product = 0;
    double power = 0;
    for (const ForwardRun& run : runs) {
        const Eigen::Index steps = run.speed_rad_per_s.size() - 1;
        const auto torque = run.torque_Nm.head(steps);
        product += torque.dot(run.speed_rad_per_s.tail(steps) - run.speed_rad_per_s.head(steps));
        power += torque.squaredNorm();
    }
    return {.gain = product / power};
}

Eigen::VectorXd simulate(const OneStepLaw& law, const ForwardRun& run) {
    Eigen::VectorXd speed(run.speed_rad_per_s.size());
    speed(0) = run.speed_rad_per_s(0);
    for (Eigen::Index k = 0; k + 1 < speed.size(); ++k) {
        const double without = law.keeps * speed(k) + law.gain * run.torque_Nm(k) + law.offset;
        const double left = std::abs(without) - law.friction;
        speed(k + 1) = std::copysign(std::max(0.0, left), without);
    }
    return speed;
}

double squared_error(const OneStepLaw& law, const ForwardRun& run) {
    return (simulate(law, run) - run.speed_rad_per_s).squaredNorm();
}

ContinuousLaw in_time(const OneStepLaw& law, double period_s) {
    if (!(law.keeps > 0) || law.keeps == 1) {
        constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
        return {kNaN, kNaN, kNaN, kNaN};
    }
    const double rate_per_s = -std::log(law.keeps) / period_s;
    const double gain = law.gain * rate_per_s / (1 - law.keeps);
    return {gain, rate_per_s / gain, law.friction / law.gain, law.offset / law.gain};
}

}  // namespace wheelwright::peers
