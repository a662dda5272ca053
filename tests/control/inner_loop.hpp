// The controllers' inner loop as a cycle runs it: observer, velocity loop, torques out. Test support.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/control/encoder_loop.hpp"
#include "firmware/control/loop_design.hpp"
#include "firmware/control/velocity_loop.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "tests/control/bench_robot.hpp"

namespace bench {

template <typename Real>
struct InnerLoop {
    wheelwright::control::PlantModel<Real> model;
    wheelwright::control::WheelObserver<Real> observer;
    wheelwright::control::VelocityLoop<Real> loop;
    wheelwright::control::LoopDesignResult<Real> design;
    wheelwright::control::DesignStatus status = wheelwright::control::DesignStatus::none;
    wheelwright::WheelPair<Real> torque;

    explicit InnerLoop(const wheelwright::model::RobotParameters& parameters) {
        constexpr Real cycle_s = Real(1e-3);
        model = wheelwright::control::plant_model<Real>(parameters);
        observer.configure(wheelwright::control::wheel_observer_settings<Real>(parameters, cycle_s));
        wheelwright::control::LoopDesign<Real> designer;
        status = designer.run(wheelwright::control::loop_design_request<Real>(parameters, cycle_s));
        design = designer.result();
        loop.configure({design.gains, Real(parameters.limits.torque_Nm), cycle_s});
    }

    // Reads the robot's encoders; call at a cycle's beginning.
    void sense(const Robot& robot) {
        const auto sample = [](const Encoder& e) {
            return wheelwright::control::EncoderSample{e.position_rad, 0.0, e.time_ns};
        };
        observer.update(robot.now_ns(), sample(robot.left), sample(robot.right), model);
    }

    // Computes and sends the torques, and lets the robot move on by one cycle.
    void act(Robot& robot, const wheelwright::control::VelocityReference<Real>& reference) {
        torque = loop.update(model, observer.motion(), reference);
        observer.torque_sent(torque);
        robot.cycle(double(torque.left), double(torque.right));
    }
};

// Angles that no drive's loop stands before.
inline std::array<wheelwright::control::EncoderAngle, 2> told_angles(
    const wheelwright::WheelPair<double>& angle_rad, const std::array<std::int64_t, 2>& time_ns) {
    return {
        {{angle_rad.left, angle_rad.left, 0, time_ns[0]}, {angle_rad.right, angle_rad.right, 0, time_ns[1]}}};
}

// The notes' robot in the controller's eyes.
inline wheelwright::model::RobotParameters notes_robot() {
    auto p = wheelwright::model::default_parameters();
    p.dynamics = {0.0413, 0, 1.40855, 6.74245};
    p.dynamics.k6_per_m = wheelwright::model::coupled_k6(p.dynamics.k5_m, p.dynamics.k7_per_kg_m,
                                                         p.dynamics.k8_per_kg_m2, p.geometry.track_m);
    return p;
}

inline void set_coulomb(wheelwright::model::RobotParameters& p, double left_Nm, double right_Nm) {
    const auto i = wheelwright::model::find_effect("coulomb_friction");
    p.effects.active[i] = true;
    p.effects.parameter[i][0] = left_Nm;
    p.effects.parameter[i][1] = right_Nm;
}

}  // namespace bench
