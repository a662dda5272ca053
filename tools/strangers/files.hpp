// The files that the drawn robots begin with, compiled in.
#pragma once

#include <string_view>

namespace wheelwright::tools::files {

extern const std::string_view template_toml;   // tools/robots/template.toml
extern const std::string_view simulated_toml;  // tools/robots/simulated.toml

}  // namespace wheelwright::tools::files
