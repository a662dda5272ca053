// The two robots of the chain tests: what the firmware believes, and what the simulated robot is. No number
// is the same in both.
#pragma once

#include <cstdlib>
#include <string>

#include "tools/sim/experiments.hpp"

namespace chain {

// Read before main(), for CppUTest counts what is allocated in a test and kept.
inline const wheelwright::task::RobotFile kBelieved =
    wheelwright::tools::load_robot(WHEELWRIGHT_ROBOTS "/default.toml");
inline const wheelwright::task::RobotFile kReal =
    wheelwright::tools::load_robot(WHEELWRIGHT_ROBOTS "/simulated.toml");

inline const wheelwright::task::RobotFile& believed() { return kBelieved; }
inline const wheelwright::task::RobotFile& real() { return kReal; }

inline wheelwright::tools::SimulationOptions options(std::uint64_t seed) {
    wheelwright::tools::SimulationOptions o;
    o.seed = seed;
    o.world = wheelwright::tools::world_options(real().simulation, seed);
    return o;
}

// The simulated robot's K5..K8, as the believed geometry makes them look.
inline wheelwright::model::Dynamics<double> truth() {
    return wheelwright::tools::as_seen_with(real().parameters.dynamics, real().parameters.geometry,
                                            believed().parameters.geometry);
}

// A firmware that has already identified the robot: K5..K8 of the truth times `model_error`, its friction,
// and the standard errors of a good identification. Geometry stays the believed one.
inline wheelwright::model::RobotParameters identified(double model_error = 1) {
    wheelwright::model::RobotParameters p = believed().parameters;
    p.dynamics = truth();
    p.dynamics.k5_m *= model_error;
    p.dynamics.k6_per_m *= model_error;
    p.dynamics.k7_per_kg_m *= model_error;
    p.dynamics.k8_per_kg_m2 *= model_error;
    p.dynamics_standard_error = {0.0003, 0.01, 0.002, 0.01};
    p.effects = real().parameters.effects;
    for (std::size_t i = 0; i < wheelwright::model::kEffectCount; ++i) {
        for (std::size_t j = 0; j < wheelwright::model::kEffects[i].parameters.size(); ++j) {
            p.effects.parameter[i][j] *= 1.03;
            p.effects_standard_error.parameter[i][j] = 0.05 * p.effects.parameter[i][j];
        }
    }
    p.velocity_loop.actuation_delay_s = 0.00142;
    return p;
}

// Seeds of a long campaign, if one is asked for; else of the sample that runs every time.
inline int seeds(int sample, int campaign) {
    const char* all = std::getenv("WHEELWRIGHT_CAMPAIGN");
    return all != nullptr && *all != '\0' ? campaign : sample;
}

}  // namespace chain
