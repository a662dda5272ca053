#include "tools/report/decimate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace wheelwright::report {
namespace {

using Indices = std::vector<std::size_t>;

Indices all(std::size_t size) {
    Indices indices(size);
    std::iota(indices.begin(), indices.end(), std::size_t{0});
    return indices;
}

// Marks the points of one unbroken piece [begin, end) that the line must pass.
void simplify(const std::vector<double>& x, const std::vector<double>& y, std::size_t begin, std::size_t end,
              double tolerance, std::vector<bool>& keep) {
    std::vector<std::pair<std::size_t, std::size_t>> open{{begin, end - 1}};
    keep[begin] = keep[end - 1] = true;
    while (!open.empty()) {
        const auto [first, last] = open.back();
        open.pop_back();
        const double dx = x[last] - x[first];
        const double dy = y[last] - y[first];
        const double square = dx * dx + dy * dy;
        double farthest = tolerance * tolerance;
        std::size_t at = first;
        for (std::size_t i = first + 1; i < last; ++i) {
            const double px = x[i] - x[first];
            const double py = y[i] - y[first];
            const double along = square > 0 ? std::clamp((px * dx + py * dy) / square, 0.0, 1.0) : 0.0;
            const double off = std::hypot(px - along * dx, py - along * dy);
            if (off * off > farthest) {
                farthest = off * off;
                at = i;
            }
        }
        if (at == first) continue;
        keep[at] = true;
        open.emplace_back(first, at);
        open.emplace_back(at, last);
    }
}

double extent(const std::vector<double>& values) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (const double value : values) {
        if (!std::isfinite(value)) continue;
        low = std::min(low, value);
        high = std::max(high, value);
    }
    return high > low ? high - low : 0;
}

}  // namespace

Indices thin_curve(const std::vector<double>& x, const std::vector<double>& y, std::size_t points,
                   bool log_x) {
    const std::size_t size = std::min(x.size(), y.size());
    Indices kept;
    const auto place = [log_x](double value) { return log_x ? std::log(value) : value; };
    const auto drawable = [&](std::size_t i) { return std::isfinite(x[i]) && (!log_x || x[i] > 0); };
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    std::size_t count = 0;
    for (std::size_t i = 0; i < size; ++i) {
        if (!drawable(i)) continue;
        ++count;
        low = std::min(low, place(x[i]));
        high = std::max(high, place(x[i]));
    }
    const bool thin = count > points && points >= 4 && high > low;
    const double buckets = std::max(1.0, std::floor(static_cast<double>(points) / 4));
    struct Bucket {
        std::size_t first = 0, lowest = 0, highest = 0, last = 0;
        double number = -1;
    } bucket;
    const auto flush = [&] {
        if (bucket.number < 0) return;
        Indices four{bucket.first, bucket.lowest, bucket.highest, bucket.last};
        std::sort(four.begin(), four.end());
        four.erase(std::unique(four.begin(), four.end()), four.end());
        kept.insert(kept.end(), four.begin(), four.end());
        bucket.number = -1;
    };
    bool broken = true;  // a line never begins with a break
    for (std::size_t i = 0; i < size; ++i) {
        if (!drawable(i) || !std::isfinite(y[i])) {
            flush();
            if (!broken && std::isfinite(x[i])) kept.push_back(i);
            broken = true;
            continue;
        }
        broken = false;
        if (!thin) {
            kept.push_back(i);
            continue;
        }
        const double number = std::min(buckets - 1, std::floor((place(x[i]) - low) / (high - low) * buckets));
        if (number != bucket.number) {
            flush();
            bucket = {i, i, i, i, number};
            continue;
        }
        bucket.last = i;
        if (y[i] < y[bucket.lowest]) bucket.lowest = i;
        if (y[i] > y[bucket.highest]) bucket.highest = i;
    }
    flush();
    return kept;
}

Indices thin_path(const std::vector<double>& x, const std::vector<double>& y, std::size_t points) {
    const std::size_t size = std::min(x.size(), y.size());
    if (size <= 2) return all(size);
    std::vector<bool> keep(size, false);
    const double tolerance = std::max(extent(x), extent(y)) / 3000;
    std::size_t begin = 0;
    for (std::size_t i = 0; i <= size; ++i) {
        if (i < size && std::isfinite(x[i]) && std::isfinite(y[i])) continue;
        if (i > begin) simplify(x, y, begin, i, tolerance, keep);
        if (i < size) keep[i] = true;
        begin = i + 1;
    }
    Indices kept;
    for (std::size_t i = 0; i < size; ++i)
        if (keep[i]) kept.push_back(i);
    if (kept.size() <= points || points < 2) return kept;
    Indices fewer;
    for (std::size_t n = 0; n < points; ++n) fewer.push_back(kept[n * (kept.size() - 1) / (points - 1)]);
    return fewer;
}

}  // namespace wheelwright::report
