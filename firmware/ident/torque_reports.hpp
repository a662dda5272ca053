// What the drives report of their torque, over what they were told, by how large that was. The same ratio for
// all torques is a wrong torque constant; one that falls with the torque is clipping.
//
// A few operations a report. No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/ident/parabola.hpp"

namespace wheelwright::ident {

class TorqueReports {
  public:
    enum class Level : std::uint8_t { ramp, push, half, whole };

    void add(Level level, double reported_over_asked) {
        by_level_[static_cast<std::size_t>(level)].add(reported_over_asked);
        any_ = true;
    }
    bool any() const { return any_; }

    // Reported over asked where nothing clips: the highest of the levels, as clipping only lowers. 1 where
    // that is so far from 1 that no torque constant can be that wrong; then all torques were clipped.
    double ratio() const {
        double highest = 0;
        for (const Mean& level : by_level_)
            if (level.count() >= kFewest) highest = std::max(highest, level.mean());
        return highest > kWorstConstant && highest < 1 / kWorstConstant ? highest : 1;
    }
    // Share of the whole amplitude that arrives; 1 while too few reports have come.
    double delivered_share() const {
        const Mean& whole = by_level_[static_cast<std::size_t>(Level::whole)];
        return whole.count() < kFewest ? 1 : whole.mean() / ratio();
    }

  private:
    static constexpr double kWorstConstant = 0.75;
    static constexpr std::uint32_t kFewest = 4;
    std::array<Mean, 4> by_level_{};
    bool any_ = false;
};

}  // namespace wheelwright::ident
