#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "tools/gap_bench/peers/peers.hpp"

namespace wheelwright::peers {
namespace {

constexpr double kStandingShare = 0.02;  // of the fastest speed learned from

}  // namespace

// ds/dt = K torque + a s + c sign(s) + b, with the torque held over a step, is over that step exactly
// s[k+1] = exp(a dt) s[k] + (K torque[k] + c sign(s) + b) (exp(a dt) - 1) / a: linear in what it multiplies.
OneStepLaw plain_least_squares(std::span<const ForwardRun> runs) {
    double top = 0;
    for (const ForwardRun& run : runs) top = std::max(top, run.speed_rad_per_s.cwiseAbs().maxCoeff());
    Eigen::Matrix4d products = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (const ForwardRun& run : runs) {
        for (const Eigen::Index k : moving_steps(run, kStandingShare * top)) {
            const double speed = run.speed_rad_per_s(k);
            const Eigen::Vector4d column(run.torque_Nm(k), speed, std::copysign(1, speed), 1);
            // the difference: numbers near 1 would hide what is slow
            products += column * column.transpose();
            right += column * (run.speed_rad_per_s(k + 1) - speed);
        }
    }
    const Eigen::Vector4d scale = products.diagonal().cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
    const Eigen::Matrix4d scaled = scale.asDiagonal() * products * scale.asDiagonal();
    const Eigen::Vector4d x = scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * right);
    return {.keeps = 1 + x(1), .gain = x(0), .friction = -x(2), .offset = x(3)};
}

}  // namespace wheelwright::peers
