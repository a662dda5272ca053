// What charts are drawn from: one value of each sample.
#pragma once

#include <vector>

namespace wheelwright::report {

// What `get` takes from each sample, in their order and in its unit. Samples: a range with size().
template <typename Samples, typename Get>
std::vector<double> column(const Samples& samples, Get&& get) {
    std::vector<double> out;
    out.reserve(samples.size());
    for (const auto& sample : samples) out.push_back(get(sample));
    return out;
}

}  // namespace wheelwright::report
