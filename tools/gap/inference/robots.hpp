// The robots that the fits of a search stand for, and their refinement once it is over.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "tools/gap/inference/search.hpp"
#include "tools/gap/model/free_run.hpp"

namespace wheelwright::gap {

// K5..K8. Where nothing is known of turning: of a robot that goes straight, with any inertia.
model::Dynamics<double> dynamics_of(const Fit& fit, bool turning, double track_m);

// The same, and for what the log cannot show (`unknowable`) some robot's: motions must be simulated with
// something, and columns be made.
model::Dynamics<double> whole_dynamics(const Fit& fit, std::span<const std::string> unknowable, bool turning,
                                       double track_m);

// `setting`: of the dictionary that the fit's columns are from.
SimulatedRobot robot_of(const std::vector<Candidate>& members, const Fit& fit, const Setting& setting,
                        bool turning);

// Of `members`, those that the model had before the search.
std::vector<Candidate> base_members(const Search& search);

// Noise in the measured speeds stands in the weak form's regressors too, and may lead it astray. Where free
// runs over the parts miss much, they have the last word, if that is clearly better: `base`, `after`, the
// named effects' parameters and `unknowable` are then theirs. Costs what output_error.hpp says, twice.
Search refined(const Search& search, std::span<const LogPart> parts, const Setting& setting, bool turning,
               double speed_rms_rad_per_s);

// What free runs of 2 s over the logs that it was found in say of what was found, less the friction that
// every drive train may have and what is shown.
struct FreeRunsSay {
    // An effect without which the simulated robot drives as close to the logs; none: there is none.
    std::optional<std::size_t> no_better;
    // Those by which it may get closer by chance: not by the ranks of the runs.
    std::vector<std::size_t> unsure;
};
// `train`: what the search worked on.
FreeRunsSay by_free_runs(const Search& search, const Blocks& train, std::span<const LogPart> parts,
                         const Setting& setting, bool turning);

// The robot file's own numbers in the place of the base's.
Fit nominal_fit(const Search& search, const model::RobotParameters& robot);

}  // namespace wheelwright::gap
