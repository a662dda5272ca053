// Where the example robots lie: beside an installed program (share/wheelwright/robots), else in the source
// tree.
#pragma once

#include <string>

namespace wheelwright::tools {

// `name`: "default.toml", "simulated.toml", ... May not exist: whoever reads it says so.
std::string example_robot(const std::string& name);

}  // namespace wheelwright::tools
