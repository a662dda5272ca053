#pragma once

#include <string>

#include "tools/report/page.hpp"
#include "tools/showcase/hidden_effect.hpp"
#include "tools/showcase/main_job.hpp"

namespace wheelwright::tools {

// The page of a demo run. `hidden`: null if it did not come to that. `interface`: "" for virtual
// time.
report::Page demo_page(const MainJob& job, const HiddenEffect* hidden, const std::string& interface);

}  // namespace wheelwright::tools
