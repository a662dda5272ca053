// The example robots, compiled in, so that the page does not depend on where the program was started.
#pragma once

#include <string_view>

namespace wheelwright::paper::robots {

extern const std::string_view believed;   // tools/robots/default.toml
extern const std::string_view simulated;  // tools/robots/simulated.toml

}  // namespace wheelwright::paper::robots
