// A9: the motions that an answer advises are driven with the robot of the trial, as `wheelwright excite`
// would drive them, and all logs are analysed as one experiment.
#pragma once

#include "tools/excite/excitation.hpp"
#include "tools/gap_trials/further.hpp"
#include "tools/gap_trials/hidden/motion.hpp"

namespace wheelwright::tools {

// What excite commands: rounds with a halt between, set-points as often, the same limits.
hidden::TorqueProgramme programme_of(const excite::Excitation& excitation);

// Drives the motions of gap.json's advice, mostly one, of the size that excite would choose with the robot
// file that lies beside it, from rest and heading as in the first log. Not asked: without an advice; where
// time goes on between two logs in a way that no log tells (payload_step, gain_drift); damaged logs.
// further.can_tell: a hidden effect is one of those that the motions are to tell apart.
void drive_advised(const Asked& asked, Further& further);

}  // namespace wheelwright::tools
