// The exam's plant: a robot on two driven wheels, its equations of motion from Lagrange's, integrated by
// Runge and Kutta's rule of fourth order. Friction, ground, tyres, teeth, castor and drives by the laws of
// laws.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>

#include "tools/gap_exam/truth/robot.hpp"

namespace wheelwright::exam {

// Torques at the wheels against their motion, means over a sample.
struct Resistance {
    Sides<double> dry_Nm{}, viscous_Nm{}, ground_Nm{};
};

class Simulator {
  public:
    // The ground is drawn as the wheels go, from `seed`; without `rough` it is even.
    Simulator(const Robot& robot, std::uint64_t seed, bool rough);

    // Each step of the integration: its length, and the angles of the encoders at its end.
    using Step = std::function<void(double step_s, const Sides<double>& angle_rad)>;

    // Holds the commands for a sample.
    void advance(const Sides<double>& asked_Nm, double period_s, const Step& step = {});

    // Where the encoders are: the wheels, but for the elastic shaft's, which are on the motors.
    Sides<double> speed_rad_per_s() const;
    Sides<double> angle_rad() const;
    double yaw_rate_rad_per_s() const { return state_[kYaw]; }
    double forward_m_per_s() const { return state_[kForward]; }
    double heading_rad() const { return state_[kHeading]; }
    double fork_rad() const { return state_[kFork]; }
    double kinetic_energy_J() const;
    const Resistance& resistance() const { return mean_; }

    void set_motion(double forward_m_per_s, double yaw_rad_per_s);
    void set_fork(double rad) { state_[kFork] = rad; }

  private:
    enum Index : std::size_t {
        kForward,
        kYaw,
        kHeading,
        kX,
        kY,
        kWheel,
        kAngle = kWheel + 2,
        kMotor = kAngle + 2,
        kTwist = kMotor + 2,
        kBend = kTwist + 2,
        kTyre = kBend + 2,
        kLag = kTyre + 2,
        kLagged = kLag + 2,
        kFork = kLagged + 2,
        kForkRate,
        kHeat,
        kCount,
    };
    using State = std::array<double, kCount>;

    struct Body {  // with the load, where there is one
        double mass_kg, moment_kg_m,
            inertia_kg_m2;  // moment: ahead; inertia about the middle between the wheels
    };
    struct Push {
        double force_N = 0, moment_Nm = 0;
    };

    bool two_masses() const;
    bool slips() const { return robot_.further == Further::wheel_slip; }
    double size() const { return robot_.amount * largest_; }
    double is(Further f) const { return robot_.further == f ? size() : 0; }
    Body body(double t_s) const;
    Sides<double> rolling_speeds(const State& s) const;
    Sides<double> wheel_speeds(const State& s) const;
    double shaft_torque_Nm(std::size_t side, double asked_Nm, const State& s, double shaft_rad_per_s,
                           State& rate) const;
    Resistance resistances(const State& s, const Sides<double>& speed) const;
    double further_friction_Nm(std::size_t side, double speed, double shaft_Nm, double t_s) const;
    Push pushes(const State& s, const Body& body, double t_s, State& rate) const;
    void roll(const State& s, const Body& body, const Push& push, const Sides<double>& torque,
              State& rate) const;
    void slip(const State& s, const Body& body, const Push& push, const Sides<double>& torque,
              State& rate) const;
    State rates(const State& s, const Sides<double>& asked, double t_s) const;
    void step(const Sides<double>& asked, double step_s);
    double longest_step_s() const;

    Robot robot_;
    double largest_ = 0;
    Random ground_;
    State state_{};
    double t_s_ = 0;
    Sides<double> rough_{};
    Resistance mean_;
    struct Command {
        double from_s;
        Sides<double> asked_Nm;
    };
    std::deque<Command> commands_;  // where they come late
    Random lateness_;
};

}  // namespace wheelwright::exam
