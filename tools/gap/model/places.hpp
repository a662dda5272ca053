// Places: functions of motion, torque and time that stand for no effect. What a model leaves is looked for
// along each, so that something that the catalogue does not have is seen, and where.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include "tools/gap/model/columns.hpp"

namespace wheelwright::gap {

// The columns beside the rich ones (Dictionary::rich_columns) along a log.
class PlaceColumns {
  public:
    explicit PlaceColumns(const Setting& setting);

    // Appends one pair for each.
    void append(const Interval& interval, std::vector<WheelPair<double>>& values);
    // Time passes.
    void advance(const Interval& interval);

    // Of each column in order: its place, and with which others it is fitted.
    struct Kind {
        std::string_view place;
        int aspect = 0;
    };
    static std::span<const Kind> kinds();

  private:
    void start(const Interval& interval);

    double peak_torque_Nm_, peak_speed_rad_per_s_;
    bool first_ = true;
    std::vector<WheelPair<double>> late_torque_, late_sign_;
};

// Columns that are fitted together.
struct Aspect {
    std::string_view place;
    std::vector<int> columns;
};
std::vector<Aspect> aspects_of(const Dictionary& dictionary);

}  // namespace wheelwright::gap
