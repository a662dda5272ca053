// The page: the paper's figures and tables, ours beside them.
#pragma once

#include "tools/paper/reproduction.hpp"
#include "tools/report/page.hpp"

namespace wheelwright::paper {

report::Page page_of(const Reproduction& from);

}  // namespace wheelwright::paper
