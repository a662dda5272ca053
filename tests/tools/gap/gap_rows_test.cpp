// Rows of regression from a log.
#include "tools/gap/gap_rows.hpp"

#include <CppUTest/TestHarness.h>

#include <array>
#include <cmath>

using namespace wheelwright;

namespace {

// Driven straight to and fro, a robot of 11 kg, 1 kHz.
tools::MeasuredLog driven(double duration_s) {
    tools::MeasuredLog log;
    log.period_s = 0.001;
    const auto count = static_cast<std::size_t>(duration_s / log.period_s);
    for (std::size_t i = 0; i <= count; ++i) {
        const double t = double(i) * log.period_s;
        tools::MeasuredSample sample;
        sample.t_s = t;
        const double torque = 0.4 * std::cos(5 * t) + 0.1 * std::cos(37 * t);
        sample.torque_Nm = {torque, torque};
        const double speed = 5 + 2 * std::sin(5 * t);
        sample.speed_rad_per_s = {speed, speed};
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
    const int column = dictionary.ways(payload).back().fixed.front();

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
