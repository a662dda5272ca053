#include "tools/excite/motions.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace wheelwright::excite {
namespace {

// NOLINTBEGIN(readability-magic-numbers): shapes of motions
constexpr std::array<Motion, 6> kMotions{{
    {"creep", "reversals at a creep", 0.15,
     [](double t, double a) {
         const double s = 0.25 * a * (std::fmod(t, 2.0) < 1 ? 1 : -1);
         return WheelPair<double>{s, s};
     }},
    {"coast", "full torque, then coasting", 1,
     [](double t, double a) {
         const double s = t < 2 ? a : 0.0;
         return WheelPair<double>{s, s};
     }},
    {"spin", "spins both ways", 0.7,
     [](double t, double a) {
         const double s = 0.5 * a * (std::fmod(t, 4.0) < 2 ? 1 : -1);
         return WheelPair<double>{-s, s};
     }},
    {"curves", "curves through all headings", 0.6,
     [](double t, double a) {
         return WheelPair<double>{0.3 * a * std::sin(0.9 * t) + 0.04 * a,
                                  0.3 * a * std::sin(0.9 * t) - 0.04 * a};
     }},
    {"three_speeds", "out and back at three speeds", 1,
     [](double t, double a) {
         const double s = a * (0.2 + 0.3 * std::floor(t / 4)) * std::sin(2 * 3.14159265 * t / 4);
         return WheelPair<double>{s, s};
     }},
    {"random", "random torques on each wheel", 0.7,
     [](double t, double a) {
         return WheelPair<double>{0.5 * a * std::sin(7.1 * t) * std::sin(1.3 * t),
                                  0.5 * a * std::sin(5.7 * t + 1) * std::sin(0.9 * t)};
     }},
}};
// NOLINTEND(readability-magic-numbers)

}  // namespace

std::span<const Motion> motions() { return kMotions; }

const Motion* find_motion(std::string_view name) {
    const auto* found = std::find_if(kMotions.begin(), kMotions.end(),
                                     [&](const Motion& motion) { return motion.name == name; });
    return found != kMotions.end() ? found : nullptr;
}

}  // namespace wheelwright::excite
