// How toml++ is used: without exceptions and without the parts we do not need. Included by robot_file*.cpp
// only.
#pragma once

#define TOML_EXCEPTIONS 0
#define TOML_ENABLE_FORMATTERS 0
#include <toml++/toml.h>
