// A page that uses everything a page can hold.
#pragma once

#include "tools/report/page.hpp"

namespace wheelwright::report {

Page sample_page();

}  // namespace wheelwright::report
