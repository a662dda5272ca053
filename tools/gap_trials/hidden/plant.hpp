// A robot that moves: what the trials drive. The mechanical effects of the set are the plant's own; the
// electrical ones happen before it (electronics.hpp).
#pragma once

#include <string_view>

#include "tools/gap_trials/hidden/effects.hpp"

namespace wheelwright::hidden {

struct PlantState {
    Pair wheel_speed_rad_per_s;  // against the body, as an encoder sees it
    Pair wheel_angle_rad;        // since the beginning
    double speed_m_per_s = 0;    // forward, of the middle of the axle
    double yaw_rate_rad_per_s = 0;
    double heading_rad = 0;
    double x_m = 0, y_m = 0;  // of the middle of the axle
    double height_m = 0;
};

class Plant {
  public:
    Plant() = default;
    Plant(const Plant&) = delete;
    Plant& operator=(const Plant&) = delete;
    virtual ~Plant() = default;

    virtual PlantState state() const = 0;
    virtual double kinetic_energy_J() const = 0;
    // One step with these torques between body and wheels.
    virtual void advance(double step_s, const Pair& torque_Nm) = 0;
    // RMS over both wheels and all steps so far of what a mechanical effect did, as torque at the wheels: to
    // size it by. 0 for effects that this cannot be said of.
    virtual double effect_rms_Nm(std::string_view effect) const = 0;
    // Distance by which the tyres slipped along their rolling direction so far, and the distance rolled; both
    // wheels together.
    virtual double slipped_m() const { return 0; }
    virtual double travelled_m() const = 0;
    // How often the solver said that it could not do a step exactly.
    virtual long complaints() const { return 0; }
};

}  // namespace wheelwright::hidden
