// Takes an output away when this process ends, however it ends. A chip may keep the level of a line whose
// user is gone (PL061 does), so a firmware that is killed would leave its drives enabled.
#pragma once

#include "hal/digital_line.hpp"

namespace wheelwright::hal {

// Starts a process that waits for the end of this one, by SIGKILL or a crash too, and then writes `line`
// inactive. It takes SCHED_FIFO at `priority` if it may. Call it before any thread is started, and before
// what else should not stay open a moment longer than this process. False: no process could be had. What it
// does not help against: both killed at once, a kernel that stands still, a process that is only stopped.
bool guard_line(DigitalOutput& line, int priority);

}  // namespace wheelwright::hal
