// What an analysis says that does not know what is hidden.
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "tests/tools/gap/hidden_effect.hpp"
#include "tests/tools/ident/temporary_file.hpp"
#include "tools/gap/analysis.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using test::HiddenLog;

namespace {

constexpr double kDuration_s = 40;
constexpr double kRate_Hz = 250;
constexpr double kNoise_rad_per_s = 0.01;

gap::Findings analyse(const HiddenLog& hidden, const std::vector<std::string>& unknown) {
    const TemporaryFile file;
    test::write_csv(hidden.log, file.path);
    gap::Request request;
    request.logs = {file.path};
    request.geometry = hidden.geometry;
    for (const std::string& name : unknown) request.without.push_back(model::find_effect(name));
    return gap::analyse(request);
}

void check_unexplained(const gap::Findings& found, const std::string& place) {
    std::string places;
    for (std::size_t i = 0; i < found.where.size() && i < 2; ++i) places += found.where[i].name + "; ";
    STRCMP_EQUAL_TEXT("unexplained", gap::verdict_name(found.conclusion.verdict), place.c_str());
    STRCMP_CONTAINS(place.c_str(), places.c_str());
}

}  // namespace

TEST_GROUP(GapPlaces){};

TEST(GapPlaces, what_no_effect_explains_is_unexplained_and_its_place_is_named) {
    const auto check = [](const test::HiddenEffect& effect, const std::vector<std::string>& names,
                          const std::string& place) {
        const HiddenLog hidden = test::hidden_log(effect, 3, kNoise_rad_per_s, kDuration_s, kRate_Hz);
        check_unexplained(analyse(hidden, names), place);
    };
    check({"torque_ripple", 0, {0.08, 7, 1.1}}, {"torque_ripple"}, "wheel angle");
    check({"payload_step", 0, {14, 2.1, 0.05}}, {"payload_step"}, "time");
    check({"torque_saturation", 0, {0.83}}, {"torque_saturation", "back_emf_limit"}, "torque");
    check({"quadratic_drag", 0.1, {2.0}}, {"quadratic_drag"}, "wheel speed");
    check({"wheel_slip", 0, {0.9, 0.05}}, {"wheel_slip"}, "lag");
    check({"backlash", 0, {0.04, 0.004}}, {"backlash"}, "lag");
}

TEST(GapPlaces, another_name_does_not_cover_what_it_leaves) {
    const HiddenLog hidden =
        test::hidden_log({"coulomb_friction", 0.1, {0.1, 0.1}}, 5, kNoise_rad_per_s, kDuration_s, kRate_Hz);
    check_unexplained(analyse(hidden, {"coulomb_friction", "stribeck_friction"}),
                      "direction of turning of the wheels");
}

TEST(GapPlaces, a_report_that_the_gyro_shows_to_be_late_is_no_lag_of_the_actuators) {
    HiddenLog hidden = test::hidden_log({}, 8, 0, kDuration_s, kRate_Hz);
    constexpr double kLag_s = 0.045;
    std::mt19937_64 random(17);
    std::normal_distribution<double> noise(0, kNoise_rad_per_s);
    WheelPair<double> late = hidden.log.samples.front().speed_rad_per_s;
    for (tools::MeasuredSample& s : hidden.log.samples) {
        const double share = 1 - std::exp(-hidden.log.period_s / kLag_s);
        late.left += share * (s.speed_rad_per_s.left - late.left);
        late.right += share * (s.speed_rad_per_s.right - late.right);
        s.speed_rad_per_s = {late.left + noise(random), late.right + noise(random)};
    }
    check_unexplained(analyse(hidden, {"measurement_lag"}), "lag");
}

TEST(GapPlaces, unequal_radii_that_the_gyro_shows_are_not_explained_by_torques) {
    // the measured speeds' mean stays; the robot turns as it drives
    HiddenLog hidden = test::hidden_log({}, 12, kNoise_rad_per_s, kDuration_s, kRate_Hz);
    for (tools::MeasuredSample& s : hidden.log.samples) {
        const double v = model::twist_from_wheel_speeds(hidden.geometry, s.speed_rad_per_s).v_m_per_s;
        s.gyro_rad_per_s += 0.03 / hidden.geometry.track_m * v;
    }
    check_unexplained(analyse(hidden, {"wheel_radius_mismatch"}), "coupling of turning and driving");
}

// The torque of each wheel is what a speed loop makes of its noisy speed: what it answers to the noise is no
// late torque. Hardly anything else drives the robot forwards.
TEST(GapPlaces, a_speed_loops_answer_to_noise_is_no_lag) {
    constexpr double kSpinNoise_rad_per_s = 0.05;
    constexpr double kStiffness_Nm_s_per_rad = 0.12;
    constexpr int kSteps = 25;  // a sample
    constexpr double kSlow_s = 0.15;
    HiddenLog hidden = test::hidden_log({}, 4, 0, 25, kRate_Hz);
    hidden.log.has_gyro = false;
    const model::Geometry<double>& g = hidden.geometry;
    const model::Dynamics<double> k{0.04, -1.2, 0.98, 5.4};
    std::mt19937_64 random(23);
    std::normal_distribution<double> noise(0, kSpinNoise_rad_per_s);
    Twist<double> twist;
    double reference_rad_per_s = 0;
    for (tools::MeasuredSample& s : hidden.log.samples) {
        s.speed_rad_per_s = model::wheel_speeds_from_twist(g, twist);
        s.speed_rad_per_s.left += noise(random);
        s.speed_rad_per_s.right += noise(random);
        const double wanted_rad_per_s = std::sin(1.3 * s.t_s) + std::sin(0.37 * s.t_s) > 0 ? 9 : -7;
        reference_rad_per_s += hidden.log.period_s / kSlow_s * (wanted_rad_per_s - reference_rad_per_s);
        s.torque_Nm = {kStiffness_Nm_s_per_rad * (-reference_rad_per_s - s.speed_rad_per_s.left),
                       kStiffness_Nm_s_per_rad * (reference_rad_per_s - s.speed_rad_per_s.right)};
        const double dt_s = hidden.log.period_s / kSteps;
        for (int i = 0; i < kSteps; ++i) {
            const TwistRate<double> rate = model::acceleration(k, twist, s.torque_Nm);
            twist.v_m_per_s += dt_s * rate.v_m_per_s2;
            twist.omega_rad_per_s += dt_s * rate.omega_rad_per_s2;
        }
    }
    const gap::Findings found = analyse(hidden, {});
    STRCMP_EQUAL_TEXT("nothing_missing", gap::verdict_name(found.conclusion.verdict),
                      found.conclusion.reason.c_str());
}
