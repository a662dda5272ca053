// Runs on a bare Cortex-M7 (or QEMU's mps2-an500): the recursive estimator in float finds K5 and K7 of the
// notes' robot from an excitation that the core's own PRBS makes. Every other object of the core is linked in
// whole, so that the image shows its size and that it needs no heap; and one of each piece that a robot needs
// stands in memory, so that it shows the size of that, too. A new piece of the core is added to Robot.
#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/control/odometry.hpp"
#include "firmware/control/pose_control.hpp"
#include "firmware/control/tracking.hpp"
#include "firmware/control/trajectory.hpp"
#include "firmware/control/velocity_loop.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/model_guard.hpp"
#include "firmware/ident/prbs.hpp"
#include "firmware/ident/ud_rls.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/supervisor/supervisor.hpp"
#include "toolchain/cortex-m7/semihosting.hpp"

namespace {

namespace control = wheelwright::control;
namespace ident = wheelwright::ident;

struct Robot {
    wheelwright::model::RobotParameters parameters;
    wheelwright::supervisor::Supervisor supervisor{{}};
    control::WheelObserver<float> observer;
    control::Odometry<float> odometry;
    control::VelocityLoop<float> velocity;
    control::PoseController<float> pose;
    control::StreamedReference<float> reference;
    control::TrajectoryTracker<float> tracker;
    ident::IdentificationRun<float> identification;
    ident::AdaptiveEstimator<float> adaptation;
    ident::ModelGuard<float> guard;
};
[[gnu::used]] Robot robot;

using wheelwright::bare::write;
using wheelwright::ident::Prbs;
using Estimator = wheelwright::ident::UdRls<float, 2>;

constexpr Estimator::Vector kTruth = {0.0413F, 1.40855F};  // K5 in m, K7 in 1/(kg m)
constexpr int kUpdates = 2000;
constexpr float kTorque_Nm = 5.0F;
constexpr float kYawGain = 0.674F;       // rad/s of yaw rate that a step of 1 Nm settles at, K8 over a decay
constexpr float kYawDecay = 0.05F;       // share of the yaw rate lost from one sample to the next
constexpr float kRelativeError = 1e-4F;  // float's own rounding is about 1e-6 on this data

std::int32_t parts_per_billion(float value) { return static_cast<std::int32_t>(std::lround(value * 1e9F)); }

}  // namespace

extern "C" int run();

int run() {
    Prbs left(wheelwright::ident::kPrbsLeft, 11, 3);
    Prbs right(wheelwright::ident::kPrbsRight, 12, 3);
    Estimator estimator;
    estimator.reset({}, {1e6F, 1e6F});

    float omega_rad_per_s = 0;
    for (int k = 0; k < kUpdates; ++k) {
        const float left_Nm = kTorque_Nm * static_cast<float>(left.next());
        const float right_Nm = kTorque_Nm * static_cast<float>(right.next());
        omega_rad_per_s += kYawDecay * (kYawGain * (right_Nm - left_Nm) - omega_rad_per_s);
        const Estimator::Vector phi = {omega_rad_per_s * omega_rad_per_s, right_Nm + left_Nm};
        estimator.update(phi, kTruth[0] * phi[0] + kTruth[1] * phi[1]);
    }

    write("one robot's core, float: ");
    write(static_cast<std::int32_t>(sizeof(Robot)));
    write(" bytes of RAM, of which adaptation ");
    write(static_cast<std::int32_t>(sizeof(Robot::adaptation)));
    write(", identification ");
    write(static_cast<std::int32_t>(sizeof(Robot::identification)));
    write("\n");

    bool converged = true;
    for (unsigned i = 0; i < kTruth.size(); ++i) {
        const float error = std::abs(estimator.theta()[i] / kTruth[i] - 1.0F);
        write(i == 0 ? "K5" : "K7");
        write(": relative error ");
        write(parts_per_billion(error));
        write(" ppb\n");
        converged = converged && error < kRelativeError;
    }
    return converged ? 0 : 3;
}
