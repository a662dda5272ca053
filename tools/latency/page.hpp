// What `wheelwright latency` found, as a page. Only in builds that write pages (WHEELWRIGHT_PAGES).
#pragma once

#include <string>
#include <vector>

#include "tools/latency/machine.hpp"
#include "tools/latency/measure.hpp"

namespace wheelwright::tools {

// Throws std::runtime_error where the page cannot be written.
void write_latency_page(const Latency& latency, const std::string& verdict, const std::vector<Advice>& advice,
                        const std::string& path);

}  // namespace wheelwright::tools
