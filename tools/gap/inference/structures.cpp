#include "tools/gap/inference/structures.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tools/gap/inference/policy.hpp"
#include "tools/gap/inference/statistics.hpp"

namespace wheelwright::gap {
namespace {

// Without the greatest of them: a single piece, the only one to turn perhaps, is predicted by the others so
// badly that anything may seem to help there.
double usual_sum(const std::vector<double>& gain) {
    const auto n = static_cast<double>(gain.size());
    if (n < 2) return 0;
    const double sum = std::accumulate(gain.begin(), gain.end(), 0.0);
    return (sum - *std::max_element(gain.begin(), gain.end())) * n / (n - 1);
}

}  // namespace

std::vector<Structure> structures_beside(const Fit& model, const Blocks& blocks,
                                         const std::vector<Aspect>& aspects) {
    const double torque = torque_squares(blocks, model);
    std::vector<Structure> all;
    for (const Aspect& aspect : aspects) {
        const std::vector<double> gain = gain_beside(blocks, model, aspect.columns);
        const double sum = usual_sum(gain);
        if (!(sum > 0)) continue;
        Structure one{aspect.place, sum, std::sqrt(sum / std::max(1e-300, torque)),
                      surely_positive(gain, kPolicy.false_alarm / double(aspects.size()))};
        const auto same =
            std::find_if(all.begin(), all.end(), [&](const Structure& s) { return s.place == one.place; });
        if (same == all.end()) {
            all.push_back(one);
        } else if (one.squares > same->squares && (one.sure || !same->sure)) {
            *same = one;
        }
    }
    std::sort(all.begin(), all.end(),
              [](const Structure& a, const Structure& b) { return a.squares > b.squares; });
    return all;
}

}  // namespace wheelwright::gap
