#pragma once

#include <string>

#include "tools/report/page.hpp"
#include "tools/showcase/main_job.hpp"

namespace wheelwright::tools {

// The page of a demo run. `interface`: "" for virtual time.
report::Page demo_page(const MainJob& job, const std::string& interface);

}  // namespace wheelwright::tools
