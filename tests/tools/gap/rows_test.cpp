// Rows of regression from a log.
#include "tools/gap/model/rows.hpp"

#include <CppUTest/TestHarness.h>

#include <array>
#include <cmath>

#include "tools/gap/hypotheses/hypotheses.hpp"

using namespace wheelwright;

namespace {

// Driven to and fro, a robot of 11 kg, 1 kHz: straight, or turning with a share of the torque and the speed.
tools::MeasuredLog driven(double duration_s, double turning = 0) {
    tools::MeasuredLog log;
    log.period_s = 0.001;
    const auto count = static_cast<std::size_t>(duration_s / log.period_s);
    for (std::size_t i = 0; i <= count; ++i) {
        const double t = double(i) * log.period_s;
        tools::MeasuredSample sample;
        sample.t_s = t;
        const double torque = 0.4 * std::cos(5 * t) + 0.1 * std::cos(37 * t);
        sample.torque_Nm = {(1 - turning * std::sin(3 * t)) * torque,
                            (1 + turning * std::sin(3 * t)) * torque};
        const double speed = 5 + 2 * std::sin(5 * t);
        sample.speed_rad_per_s = {(1 - turning * std::cos(3 * t)) * speed,
                                  (1 + turning * std::cos(3 * t)) * speed};
        log.samples.push_back(sample);
    }
    return log;
}

}  // namespace

TEST_GROUP(GapRows){};

// A load takes the same share of the torque's acceleration in every row after it has come, also where a part
// of a log begins after that and where samples before a block are left out.
TEST(GapRows, what_was_passed_over_is_in_no_row) {
    gap::Setting setting;
    setting.geometry = {{0.079, 0.079}, 0.37};
    setting.dynamics = {0.04, 1, 1.05, 5.1};
    const std::size_t payload = model::find_effect("payload_step");
    const double mass_kg = 2;
    const gap::Dictionary dictionary(setting, {{payload, {0.5, mass_kg, 0}}}, false);
    const int column = dictionary.candidates(payload).back().fixed.front();

    const tools::MeasuredLog log = driven(6);
    std::vector<bool> unusable(log.samples.size());
    for (std::size_t i = 4000; i < 4153; ++i) unusable[i] = true;
    gap::BlockOptions options;
    options.dictionary = &dictionary;
    options.noise_rad_per_s = {0.01, 0.01};
    options.speed_rms_rad_per_s = 5;
    const gap::LogPart part{&log, 0, 2000, log.samples.size(), 0, &unusable};
    const gap::BlockSet set = gap::make_blocks(std::array{part}, options);
    CHECK_EQUAL(2, set.blocks.size());

    const double whole_kg = 1 / (1.05 * 0.079);
    const double share = whole_kg / (whole_kg + mass_kg) - 1;
    for (const gap::Block& block : set.blocks) {
        const Eigen::MatrixXd& rows = block.row[gap::kLinear];
        const double size = rows.col(gap::Dictionary::kTorque).norm();
        for (Eigen::Index k = 0; k < rows.rows(); ++k) {
            DOUBLES_EQUAL(share * rows(k, gap::Dictionary::kTorque), rows(k, column), 1e-9 * size);
        }
    }
}

// With other K5..K8 and a focus: what is kept of the first dictionary is what the second would have made.
TEST(GapRows, kept_columns_are_those_made_anew) {
    gap::Setting setting;
    setting.geometry = {{0.079, 0.081}, 0.37};
    setting.dynamics = {0.04, 1, 1.05, 5.1};
    setting.span_s = 6;
    const gap::Dictionary first(setting, {});
    setting.dynamics = {-0.02, 0.7, 1.3, 4.2};
    setting.refinements = 1;
    const gap::Dictionary second(setting, {{model::find_effect("stribeck_friction"), {0.1, 0.2, 1}}});

    const tools::MeasuredLog log = driven(6, 0.6);
    gap::BlockOptions options;
    options.noise_rad_per_s = {0.01, 0.01};
    options.speed_rms_rad_per_s = 5;
    const gap::LogPart part{&log, 0, 0, log.samples.size(), 0, nullptr};
    options.dictionary = &second;
    const gap::BlockSet anew = gap::make_blocks(std::array{part}, options);
    gap::KeptColumns kept;
    options.kept = &kept;
    options.dictionary = &first;
    gap::make_blocks(std::array{part}, options);
    const std::size_t had = kept.source.size();
    options.dictionary = &second;
    const gap::BlockSet from_kept = gap::make_blocks(std::array{part}, options);

    CHECK(had > first.columns().size() / 2);
    // foci and what depends on K5..K8 are not kept; a backlash is tried with other inertias
    for (std::size_t i = had; i < kept.source.size(); ++i)
        CHECK_EQUAL(model::find_effect("backlash"), kept.source[i].effect);
    CHECK_EQUAL(anew.blocks.size(), from_kept.blocks.size());
    for (std::size_t b = 0; b < anew.blocks.size(); ++b) {
        for (std::size_t e = 0; e < gap::kEquations; ++e) {
            const Eigen::MatrixXd& wanted = anew.blocks[b].row[e];
            const Eigen::MatrixXd& is = from_kept.blocks[b].row[e];
            for (Eigen::Index c = 0; c < wanted.cols(); ++c)
                DOUBLES_EQUAL(0, (is.col(c) - wanted.col(c)).norm(), 1e-9 * wanted.col(c).norm() + 1e-12);
        }
    }
    DOUBLES_EQUAL(0, (from_kept.wheel_power - anew.wheel_power).norm(), 1e-12 * anew.wheel_power.norm());
}

// Against friction a robot turns steadily although its torques differ: however late its speeds are reported,
// they show nothing of that.
TEST(GapRows, a_late_report_does_nothing_in_steady_motion) {
    gap::Setting setting;
    setting.geometry = {{0.08, 0.08}, 0.4};
    setting.dynamics = {0.06, -1.5, 0.9, 4.0};
    const gap::Hypothesis& late = gap::hypothesis_of(model::find_effect("measurement_lag"));
    const auto column = late.columns({0.05}, setting);
    gap::Interval interval;
    interval.dt_s = 0.01;
    interval.torque = interval.torque_before = {0.2, 0.5};
    interval.before = interval.after = {4, 9};
    WheelPair<double> last;
    for (int i = 0; i < 200; ++i) last = column->over(interval);
    DOUBLES_EQUAL(0, last.left, 1e-9);
    DOUBLES_EQUAL(0, last.right, 1e-9);
}
