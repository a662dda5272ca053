#include "tools/gap/hypotheses/starting_points.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace wheelwright::gap {
namespace {

using model::Parameters;

Parameters<double> as_it_is(const Parameters<double>& at, const Eigen::VectorXd&) { return at; }
std::vector<Parameters<double>> alone(const Parameters<double>& at) { return {at}; }
// The one parameter grows with the amount.
Parameters<double> scaled(const Parameters<double>& at, const Eigen::VectorXd& a) { return {at[0] * a(0)}; }
bool any_size(const Eigen::VectorXd&) { return true; }
bool near_one(const Eigen::VectorXd& a) { return a(0) > 0.45 && a(0) < 2.2; }
bool roughly_one(const Eigen::VectorXd& a) { return a(0) > 0.2 && a(0) < 4; }

// NOLINTBEGIN(readability-magic-numbers): points
template <typename Effect>
Grid grid_of(const Setting&) {
    return {};
}
template <>
Grid grid_of<model::StribeckFriction>(const Setting&) {
    return {{{0, 0, 0.4}, {0, 0, 0.8}, {0, 0, 1.6}, {0, 0, 3.2}},
            [](const Parameters<double>& at) {
                return std::vector<Parameters<double>>{{1, 1, at[2]}, {0, 1, at[2]}};
            },
            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                return Parameters<double>{a(0), a(0) + a(1), at[2]};
            },
            [](const Eigen::VectorXd& a) { return a(0) > 0 && a(1) > 0.1 * a(0); },
            {0.01, 0.01, 0.05}};
}
template <>
Grid grid_of<model::CastorDrag>(const Setting& s) {
    Grid grid{{},
              [](const Parameters<double>& at) {
                  return std::vector<Parameters<double>>{{1, 0, at[2], at[3]}, {0, 1, at[2], at[3]}};
              },
              [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                  return Parameters<double>{a(0), a(1), at[2], at[3]};
              },
              [](const Eigen::VectorXd& a) { return a(0) > 0; },
              {0.01, 0.001, 0.01, 0.002}};
    for (const double arm : {-0.6, 0.45, 0.65, 0.9}) {
        for (const double trail : {0.02, 0.03, 0.042})
            grid.points.push_back({0, 0, arm * s.geometry.track_m, trail});
    }
    // the trail has minima beside the right one
    if (s.closer_looks > 0) {
        const double spread = std::pow(4.0, -s.closer_looks);
        grid.closer = [=](const Parameters<double>& at) {
            std::vector<Parameters<double>> points{at};
            if (spread > 0.01) {
                for (const double factor : {1 - spread, 1 + spread})
                    points.insert(points.begin(), {at[0], at[1], at[2], factor * at[3]});
            }
            return points;
        };
    }
    return grid;
}
template <>
Grid grid_of<model::CogLateral>(const Setting&) {
    return {{{1}}, alone, scaled, any_size, {0.001}};
}
template <>
Grid grid_of<model::WheelRadiusMismatch>(const Setting&) {
    return {{{0.02}}, alone, scaled, any_size, {0.002}};
}
template <>
Grid grid_of<model::ActuatorLag>(const Setting&) {
    return {{{0.006}, {0.012}, {0.025}, {0.05}, {0.1}}, alone, scaled, near_one, {0.0005}};
}
template <>
Grid grid_of<model::TransportDelay>(const Setting&) {
    return {{{0.002}, {0.004}, {0.008}, {0.016}, {0.03}}, alone, scaled, near_one, {0.0005}};
}
template <>
Grid grid_of<model::DeadZone>(const Setting& s) {
    Grid grid{{}, alone, scaled, near_one, {0.01 * s.peak_torque_Nm}};
    for (const double share : {0.03, 0.06, 0.12, 0.24}) grid.points.push_back({share * s.peak_torque_Nm});
    return grid;
}
template <>
Grid grid_of<model::Backlash>(const Setting& s) {
    const double r = s.geometry.mean_radius_m();
    const double whole = s.effective_mass_kg() * r * r / 2;
    // How long the gap lasts is told by gap times inertia alone; the inertia is a usual one.
    constexpr double kMotorsShare = 0.75 * model::kRotationShare;
    Grid grid{{}, alone, as_it_is, roughly_one, {0.001, 0}};
    for (const double gap : {0.006, 0.0085, 0.012, 0.017, 0.024, 0.034, 0.048, 0.068, 0.096})
        grid.points.push_back({gap, kMotorsShare * whole});
    return grid;
}
template <>
Grid grid_of<model::TorqueSaturation>(const Setting& s) {
    Grid grid{{}, alone, as_it_is, roughly_one, {0.01 * s.peak_torque_Nm}};
    for (const double share : {0.93, 0.85, 0.72, 0.55, 0.4})
        grid.points.push_back({share * s.peak_torque_Nm});
    return grid;
}
template <>
Grid grid_of<model::BackEmfLimit>(const Setting& s) {
    Grid grid{{}, alone, as_it_is, roughly_one, {0.01 * s.peak_torque_Nm, 0.01 * s.peak_speed_rad_per_s}};
    const auto add = [&](double stall, double no_load) {
        grid.points.push_back({stall * s.peak_torque_Nm, no_load * s.peak_speed_rad_per_s});
    };
    for (const double stall : {0.7, 0.85, 1.0, 1.2, 1.5}) {
        for (const double no_load : {1.05, 1.25, 1.5, 1.9}) add(stall, no_load);
    }
    // what is far below the torque that is asked for keeps the robot slow
    for (const double stall : {0.45, 0.57}) {
        for (const double no_load : {1.25, 1.7, 2.3}) add(stall, no_load);
    }
    grid.itself = [most = 4 * s.peak_speed_rad_per_s](const Parameters<double>& p) { return p[1] < most; };
    return grid;
}
template <>
Grid grid_of<model::WheelSlip>(const Setting&) {
    // how much force is the limit does not show where none is reached
    return {{{1, 0.3}},
            alone,
            [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                return Parameters<double>{at[0], at[1] * a(0)};
            },
            [](const Eigen::VectorXd& a) { return a(0) > 0; },
            {0, 0.005},
            {0, 0, 0.01},
            model::kRotationShareError};
}
template <>
Grid grid_of<model::PayloadStep>(const Setting& s) {
    const double mass = s.effective_mass_kg();
    const double inertia = s.effective_inertia_kg_m2();
    constexpr double kUnit = 0.1;  // of the robot's own
    // what is lost of the gain by a unit, and what load loses so much of it
    constexpr double kLost = kUnit / (1 + kUnit);
    const auto load = [](double amount) {
        const double lost = std::clamp(kLost * amount, -0.6, 0.6);
        return lost / (1 - lost);
    };
    Grid grid{
        {},
        [=](const Parameters<double>& at) {
            return std::vector<Parameters<double>>{{at[0], kUnit * mass, 0}, {at[0], 0, kUnit * inertia}};
        },
        [=](const Parameters<double>& at, const Eigen::VectorXd& a) {
            return Parameters<double>{at[0], mass * load(a(0)), inertia * load(a(a.size() - 1))};
        },
        // what more than doubles the robot is no load
        [=](const Eigen::VectorXd& a) {
            return a.minCoeff() > -5 && a.sum() > 0 && kLost * a.maxCoeff() < 0.5;
        },
        {0, mass / 100, inertia / 100}};
    for (int i = 2; i <= 16; ++i) grid.points.push_back({s.span_s * i * kEventSpacing});
    grid.beside = {0, 0, 0, 0.01};
    grid.expected = 0.03;
    // a load's inertia does not show where the robot goes straight before or behind: then it is like the
    // robot's
    grid.hidden = 2;
    grid.itself = [=](const Parameters<double>& p) { return p[2] > -inertia / 2 && p[2] < 2 * inertia; };
    constexpr double kLikely = 0.5;  // of the robot's own
    grid.likely_amount = kLikely / kUnit;
    grid.likely_move = {0, kLikely * mass, kLikely * inertia};
    if (s.event_spacing_s == 0) return grid;
    grid.closer = [=](const Parameters<double>& at) {
        std::vector<Parameters<double>> points;
        for (const int i : {-4, 4, -3, 3, -2, 2, -1, 1, 0}) {
            points.push_back(
                {std::clamp(at[0] + i * s.event_spacing_s, 0.02 * s.span_s, 0.98 * s.span_s), at[1], at[2]});
        }
        return points;
    };
    return grid;
}
template <>
Grid grid_of<model::GainDrift>(const Setting& s) {
    Grid grid{{{0.1, 0}, {0.1, 0.15 * s.span_s}, {0.1, 0.4 * s.span_s}},
              alone,
              [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                  return Parameters<double>{at[0] * a(0), at[1]};
              },
              [](const Eigen::VectorXd& a) { return a(0) > 0 && a(0) < 9; },
              {0.01, 0.02 * s.span_s}};
    grid.apart_at_zero = 1;
    return grid;
}
template <>
Grid grid_of<model::TorqueRipple>(const Setting& s) {
    // the wheels alike, and one against the other
    constexpr double kPi = std::numbers::pi;
    Grid grid{{},
              [](const Parameters<double>& at) {
                  const double n = at[1];
                  return std::vector<Parameters<double>>{
                      {1, n, 0, 0}, {1, n, kPi / 2, 0}, {1, n, 0, kPi}, {1, n, kPi / 2, kPi}};
              },
              [](const Parameters<double>& at, const Eigen::VectorXd& a) {
                  const std::complex<double> left{a(0) + a(2), a(1) + a(3)};
                  const std::complex<double> right{a(0) - a(2), a(1) - a(3)};
                  return Parameters<double>{(std::abs(left) + std::abs(right)) / 2, at[1], std::arg(left),
                                            std::arg(right * std::conj(left))};
              },
              any_size,
              {}};
    // less than two periods are like anything that changes slowly
    constexpr double kLeast_rad = 4 * std::numbers::pi;
    for (int order = 1; order <= kMostOrder; ++order) {
        if (order * s.turned_rad >= kLeast_rad) grid.points.push_back({0, double(order), 0});
    }
    return grid;
}
template <>
Grid grid_of<model::MeasurementLag>(const Setting&) {
    return {{{0.01}, {0.025}, {0.06}, {0.15}}, alone, scaled, near_one, {0.001}};
}
// NOLINTEND(readability-magic-numbers)

}  // namespace

Grid grid_of(std::size_t effect, const Setting& s) {
    Grid grid;
    std::array<bool, model::kEffectCount> one{};
    one[effect] = true;
    model::for_each_active(one, [&]<typename Effect>(std::size_t) {
        if constexpr (model::kCoordinates<Effect> == 0) grid = grid_of<Effect>(s);
    });
    return grid;
}

}  // namespace wheelwright::gap
