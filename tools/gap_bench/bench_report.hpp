// The benchmark's tables, figures and aims.
#pragma once

#include <string>
#include <vector>

#include "tools/cli/report.hpp"
#include "tools/gap_bench/splits.hpp"

namespace wheelwright::bench {

struct Aim {
    std::string key, words;
    double measured = 0, wanted = 0;
    bool at_most = false;  // else at least

    bool reached() const { return at_most ? measured <= wanted : measured >= wanted; }
};

// All over the splits whose held-out log can be used; a refusal is infinitely far off and names nothing.
std::vector<Aim> corpus_aims(const std::vector<Split>& splits);
// Of one log, split at several places.
std::vector<Aim> one_log_aims(const std::vector<Split>& splits);
bool all_reached(const std::vector<Aim>& aims);
void add_aims(tools::Report& report, const std::vector<Aim>& aims);

double median(std::vector<double> values);  // not a number of none

tools::Report corpus_report(const std::vector<Split>& splits);
tools::Report one_log_report(const std::vector<Split>& splits);

}  // namespace wheelwright::bench
