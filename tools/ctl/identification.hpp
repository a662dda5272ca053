// The wait for an identification's end: progress, the end in words, what is kept.
#pragma once

#include "tools/ctl/link.hpp"

namespace wheelwright::tools {

// From the ident mode, or on the way into it, until the robot is idle and stands. Ctrl-C sends idle. kDone:
// K7 and K8 are known.
int await_identification(Link& link);

}  // namespace wheelwright::tools
