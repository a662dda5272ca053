// Building blocks of the judge's measures: shares with their interval, figures, medians.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace wheelwright::tools {

// 95 % interval of a probability after `hits` in `n` (Clopper and Pearson 1934); n 0 gives [0, 1].
std::pair<double, double> clopper_pearson(std::size_t hits, std::size_t n);

struct Measure {
    std::string id;  // "A1"
    std::string meaning;
    std::optional<double> value;  // nothing: no trial tells
    std::string unit;
    std::size_t hits = 0;  // of n, where it is a share
    std::size_t n = 0;
    std::optional<std::pair<double, double>> interval;
    double accept = 0;
    double aim = 0;
    bool smaller_is_better = false;
    std::optional<double> judged;  // what is compared, where that is not the value: a bound
    std::string remark;

    // Nothing without a value.
    std::optional<bool> accepted() const;
    std::optional<bool> aimed() const;
};

// `hits` of `n` in per cent; without a value where n is 0.
Measure share(std::string id, std::string meaning, std::size_t hits, std::size_t n, double accept, double aim,
              bool smaller_is_better = false);
Measure figure(std::string id, std::string meaning, std::optional<double> value, std::size_t n,
               std::string unit, double accept, double aim, bool smaller_is_better);

// Of at least one value.
double median(std::vector<double> values);
double quantile(std::vector<double> values, double share);

}  // namespace wheelwright::tools
