#include "tools/gap_trials/measures.hpp"

#include <algorithm>
#include <cmath>

namespace wheelwright::tools {
namespace {

// P(X >= hits) for n tries of probability p.
double upper_tail(std::size_t hits, std::size_t n, double p) {
    double sum = 0;
    const auto dn = static_cast<double>(n);
    for (std::size_t k = hits; k <= n; ++k) {
        const auto dk = static_cast<double>(k);
        sum += std::exp(std::lgamma(dn + 1) - std::lgamma(dk + 1) - std::lgamma(dn - dk + 1) +
                        (k > 0 ? dk * std::log(p) : 0) + (k < n ? (dn - dk) * std::log1p(-p) : 0));
    }
    return sum;
}

template <typename Below>
double bisect(Below below) {
    double low = 0;
    double high = 1;
    for (int i = 0; i < 60; ++i) {
        const double middle = (low + high) / 2;
        (below(middle) ? low : high) = middle;
    }
    return (low + high) / 2;
}

}  // namespace

std::pair<double, double> clopper_pearson(std::size_t hits, std::size_t n) {
    if (n == 0) return {0, 1};
    constexpr double kTail = 0.025;
    const double low = hits == 0 ? 0 : bisect([&](double p) { return upper_tail(hits, n, p) < kTail; });
    const double high =
        hits == n ? 1 : bisect([&](double p) { return 1 - upper_tail(hits + 1, n, p) > kTail; });
    return {low, high};
}

std::optional<bool> Measure::accepted() const {
    if (!value) return std::nullopt;
    const double compared = judged.value_or(*value);
    return smaller_is_better ? compared <= accept : compared >= accept;
}

std::optional<bool> Measure::aimed() const {
    if (!value) return std::nullopt;
    const double compared = judged.value_or(*value);
    return smaller_is_better ? compared <= aim : compared >= aim;
}

Measure figure(std::string id, std::string meaning, std::optional<double> value, std::size_t n,
               std::string unit, double accept, double aim, bool smaller_is_better) {
    Measure m;
    m.id = std::move(id);
    m.meaning = std::move(meaning);
    m.value = value;
    m.n = n;
    m.unit = std::move(unit);
    m.accept = accept;
    m.aim = aim;
    m.smaller_is_better = smaller_is_better;
    return m;
}

Measure share(std::string id, std::string meaning, std::size_t hits, std::size_t n, double accept, double aim,
              bool smaller_is_better) {
    Measure m = figure(std::move(id), std::move(meaning), std::nullopt, n, std::string("%"), accept, aim,
                       smaller_is_better);
    m.hits = hits;
    if (n > 0) {
        m.value = 100.0 * static_cast<double>(hits) / static_cast<double>(n);
        const auto [low, high] = clopper_pearson(hits, n);
        m.interval = {100 * low, 100 * high};
    }
    return m;
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const std::size_t half = values.size() / 2;
    return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

double quantile(std::vector<double> values, double share) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

}  // namespace wheelwright::tools
