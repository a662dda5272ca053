// Files that every page carries; their contents are compiled in (embed.cmake).
#pragma once

#include <string_view>

namespace wheelwright::report::assets {

extern const std::string_view chart_js;  // Chart.js 3.9.1, MIT licence, as Debian ships it
extern const std::string_view page_css;
extern const std::string_view page_js;

}  // namespace wheelwright::report::assets
