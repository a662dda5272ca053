// The simulated robot's body: a differential drive with the effects of the catalogue, its own numbers, and
// dry friction that holds exactly.
//
// Equations, in u = (v, omega) with generalised masses M:
//   M u' = (c omega^2 + F, d v omega + N) + G^T (torque + smooth effects - dry effects),   w = G u,
// where w are the wheel speeds, F, N an external push, and G follows from radii and track. With d = -c (true
// for every physical robot) the velocity terms do no work. M has an off-diagonal entry when the centre of
// gravity is off the middle line or the wheels differ. For equal wheels this is eq (42), (43) with
// K7 = 1 / (M11 r), K8 = b / (2 r M22), K5 = c / M11, K6 = d / M22.
//
// Effects that change the robot or the torque's way are the robot's own here: radii, lateral centre of
// gravity, payload and motors behind backlash go into geometry and M, the way's effects stand before the
// wheels. Only tyres that slip give the wheels a motion of their own: then J w' = torque - radius force for
// each wheel, with the tyres' forces and all dry friction solved together, in short implicit steps.
//
// One step is a midpoint step of everything smooth, each half followed by the dry torques as a
// complementarity problem (each is at its limit against the sliding, or inside its limits and nothing slides;
// Moreau's time stepping), solved by projected Gauss-Seidel from the last solution. A step in which sliding
// ends or reverses is cut there, so the result hardly depends on the step. A wheel that sticks has speed
// zero, exactly. Plain arithmetic only: the same bits on every machine.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/effects.hpp"
#include "firmware/model/torque_path.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::sim {

struct PlantParameters {
    model::Geometry<double> geometry;
    double mass_kg = 0;             // M11: with the wheels' rotation
    double inertia_kg_m2 = 0;       // M22: about the axle's middle, with the wheels' rotation
    double mass_coupling_kg_m = 0;  // M12 = M21
    double centrifugal_kg_m = 0;    // c: mass times distance of the centre of gravity ahead of the axle
    double coriolis_kg_m = 0;       // d: minus the same in physical robots
    model::EffectSet<double> effects;
    double wheel_inertia_kg_m2 = 0;     // one wheel's, part of M; 0: kRotationShare tells
    double span_s = 60;                 // over which a linear gain drift takes its whole loss
    double start_s = 0;                 // since the beginning of the run, for effects that know the time
    WheelPair<double> start_angle_rad;  // of the wheels
    // A fault on purpose: this wheel has no floor below it. It turns against its own inertia and friction,
    // and the other one alone pushes the robot. Only with the effect wheel_slip: a tyre without load.
    WheelPair<bool> lifted{};
};

// K7 and K8 must be positive. K5 and K6 are taken as they are, coupled or not.
PlantParameters plant_from_dynamics(const model::Geometry<double>& geometry,
                                    const model::Dynamics<double>& dynamics,
                                    const model::EffectSet<double>& effects);

PlantParameters plant_from_mass(const model::Geometry<double>& geometry,
                                const model::MassProperties<double>& body,
                                const model::EffectSet<double>& effects);

// K5..K8 of a plant whose wheels are equal and whose mass coupling is zero; else of the nearest such one.
model::Dynamics<double> plant_dynamics(const PlantParameters& parameters);

// Something put on the robot, with its own centre of gravity at (ahead, left) of the axle's middle.
struct Payload {
    double mass_kg = 0;
    double inertia_kg_m2 = 0;  // about its own centre of gravity
    double ahead_m = 0;
    double left_m = 0;
};

// An external push on the body, at the axle's middle, in the body frame.
struct Disturbance {
    double force_N = 0;
    double yaw_torque_Nm = 0;
};

// What acted in the last step, at the wheels.
struct PlantTorques {
    WheelPair<double> motor_Nm;           // what arrived at the wheels of the torque asked
    WheelPair<double> smooth_effects_Nm;  // at the step's midpoint
    WheelPair<double> dry_effects_Nm;
};

class Plant {
  public:
    explicit Plant(const PlantParameters& parameters, const Pose<double>& start = {});

    // Advances by `dt_s` in (0, 0.0005] under wheel torques whose mean over the step is `torque_Nm`.
    // Cost: about 200 instructions with viscous and Coulomb friction.
    void advance(double dt_s, const WheelPair<double>& torque_Nm);

    // New numbers from the next step on. Speeds and pose stay (what comes on board moves with the robot).
    void set_parameters(const PlantParameters& parameters);
    void add_payload(const Payload& payload);
    void set_disturbance(const Disturbance& disturbance) { disturbance_ = disturbance; }

    // Puts the state; wheel angles stay. Tyres slip only with the effect wheel_slip.
    void place(const Pose<double>& pose, const Twist<double>& twist,
               const WheelPair<double>& slip_m_per_s = {});

    // As given: without what effects make of them.
    const PlantParameters& parameters() const { return parameters_; }
    // With unequal radii, payload on board, lateral centre of gravity, and without motors behind backlash.
    const PlantParameters& actual() const { return actual_; }
    const Pose<double>& pose() const { return pose_; }  // heading not wrapped
    const Twist<double>& twist() const { return twist_; }
    const WheelPair<double>& wheel_speed_rad_per_s() const { return speed_; }
    const WheelPair<double>& wheel_angle_rad() const { return angle_; }
    double time_s() const { return time_s_; }  // of all steps so far
    // Speed of each tyre over the floor, along its rolling direction: 0 without the effect wheel_slip.
    WheelPair<double> slip_m_per_s() const;
    PlantTorques torques() const { return {motor_Nm_, smooth_Nm_, dry_torque_Nm()}; }
    bool at_rest() const { return speed_.left == 0 && speed_.right == 0; }
    double kinetic_energy_J() const;

  private:
    using BodyForce = model::BodyForce<double>;
    struct Matrix {  // rows: left, right wheel
        double a11 = 0, a12 = 0, a21 = 0, a22 = 0;
    };
    struct DryEffect {
        WheelPair<double> direction;
        WheelPair<double> response;  // wheel acceleration per unit of lambda
        double limit_Nm = 0;
        double compliance = 0;  // sliding acceleration per unit of lambda
        double lambda_Nm = 0;   // the solution of the last step
        // In the form of slipping tyres, where a direction may also be one of the body:
        BodyForce body;
        bool on_body = false;
        enum class Law : std::uint8_t { constant, stribeck, castor } law = Law::constant;
        unsigned which = 0;  // of the law's directions
    };
    struct Contact {  // of a tyre that slips
        BodyForce on_body;
        double radius_m = 0;
        double compliance = 0;  // slip per impulse
        double force_N = 0;
    };

    template <bool kWheelsOnly>
    [[gnu::always_inline]] inline WheelPair<double> acceleration(const WheelPair<double>& speed,
                                                                 const WheelPair<double>& torque_Nm,
                                                                 double since_s,
                                                                 WheelPair<double>& smooth_Nm) const;
    void derive_actual();
    void list_dry();
    void derive_slip();
    void renew_dry();
    void set_direction(DryEffect& dry, const WheelPair<double>& direction) const;
    [[gnu::noinline]] void advance_with_all(double dt_s, const WheelPair<double>& torque_Nm);
    double step_slipping(double rest_s, const WheelPair<double>& torque_Nm);
    double lateral_slope_Nm(const model::EffectContext<double>& context) const;
    static Matrix inverse_of(double a11, double a12, double a22);
    Twist<double> body_response(const BodyForce& push) const;
    double step(double dt_s, const WheelPair<double>& torque_Nm, bool may_cut);
    [[gnu::noinline]] double step_sticking(double dt_s, const WheelPair<double>& torque_Nm, bool may_cut,
                                           WheelPair<double>& speed, WheelPair<double>& smooth_Nm);
    template <bool kWheelsOnly>
    [[gnu::noinline]] bool step_sliding(double dt_s, const WheelPair<double>& torque_Nm,
                                        WheelPair<double>& speed, WheelPair<double>& smooth_Nm);
    void solve_dry(double dt_s, WheelPair<double>& speed);
    double cut_at(double dt_s, const WheelPair<double>& without_dry, const WheelPair<double>& speed) const;
    WheelPair<double> dry_torque_Nm() const;
    void advance_pose(double distance_m, double turn_rad);
    Twist<double> twist_of(const WheelPair<double>& speed) const;

    static constexpr std::size_t kMostDry = model::kMaxColumns + 4;  // with Stribeck's and the castor's

    PlantParameters parameters_;
    Disturbance disturbance_;
    // Derived from parameters_.
    PlantParameters actual_;
    model::EffectSet<double> path_effects_;  // with the bias, where it is part of the way
    double lateral_m_ = 0;                   // of the centre of gravity
    model::Dynamics<double> dynamics_;       // as the effects see it
    bool wheels_only_ = true;   // no smooth effect but on each wheel by itself: the usual, quick case
    bool plain_ = true;         // none but smooth and dry effects of constant size
    bool torque_path_ = false;  // an effect changes the torque on its way to the wheels
    bool dry_changes_ = false;  // friction whose size or direction changes
    bool slips_ = false;
    bool castor_turns_ = false;
    double payload_s_ = -1;  // when it comes; negative: none
    bool loaded_ = false;
    Matrix from_body_;  // body acceleration per force without the wheels' inertia; used where tyres slip
    double slip_load_N_ = 0;
    std::array<Contact, 2> contact_;
    Matrix from_torque_;  // wheel acceleration per wheel torque: G M^-1 G^T
    Matrix from_force_;   // wheel acceleration per body force: G M^-1; columns: forward, yaw
    std::array<DryEffect, kMostDry> dry_{};
    std::size_t dry_count_ = 0;

    double time_s_ = 0;
    std::array<model::PathMemory<double>, 2> path_memory_;  // left, right
    model::CastorDrag::Memory<double> castor_;

    WheelPair<double> speed_;
    WheelPair<double> angle_;
    Twist<double> twist_;
    Pose<double> pose_;
    double heading_cosine_ = 1;
    double heading_sine_ = 0;
    WheelPair<double> motor_Nm_;
    WheelPair<double> smooth_Nm_;
};

}  // namespace wheelwright::sim
