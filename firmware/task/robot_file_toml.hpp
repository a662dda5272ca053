// How toml++ is used: without exceptions and without the parts we do not need. Included by robot_file*.cpp
// only.
#pragma once

#define TOML_EXCEPTIONS 0
#define TOML_ENABLE_FORMATTERS 0
// A damaged file is an error to report, not a reason to abort: toml++ asserts on some in debug builds.
#define TOML_ASSERT(condition) static_cast<void>(0)  // NOLINT(cppcoreguidelines-macro-usage)
#include <toml++/toml.h>
