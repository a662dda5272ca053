// Fits on blocks of rows, and their refinement by output error.
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <random>
#include <string_view>
#include <vector>

#include "sim_hal/plant.hpp"
#include "tests/tools/gap/hidden_effect.hpp"
#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/misfit.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/model/fit.hpp"
#include "tools/gap/model/free_run.hpp"
#include "tools/gap/model/output_error.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr double kGain = 1.7;    // of the torque
constexpr double kAmount = 0.3;  // of the effect, as a share of the gain

// 24 blocks of one equation: y = gain (torque + amount column) + white noise. The column acts in the first
// `acting` of them only, with an amount that differs by `spread` from block to block.
struct Experiment {
    std::vector<gap::Block> blocks;
    gap::Blocks pointers;

    // `rising`: how much more the amount is in the quickest row than in the slowest.
    Experiment(unsigned seed, int acting, double spread = 0, double rising = 0, double mean = kAmount) {
        std::mt19937 engine(seed);
        std::normal_distribution<double> normal;
        constexpr int kRows = 20;
        for (int b = 0; b < 24; ++b) {
            gap::Block block;
            block.first_Hz = 0.25;
            block.rows = {kRows, 0};
            const double amount = mean + spread * normal(engine);
            // product, torque, timing, column, y
            Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(kRows, 5);
            for (int k = 0; k < kRows; ++k) {
                rows(k, 0) = normal(engine);
                rows(k, 1) = 3 * normal(engine);
                rows(k, 2) = normal(engine);
                rows(k, 3) = b < acting ? normal(engine) : 0;
                const double there = amount + rising * (k + 0.5 - kRows / 2.0) / kRows;
                rows(k, 4) = kGain * (rows(k, 1) + there * rows(k, 3)) + normal(engine);
            }
            block.row = {rows, Eigen::MatrixXd::Zero(0, 5)};
            block.product = {rows.transpose() * rows, Eigen::MatrixXd::Zero(5, 5)};
            blocks.push_back(block);
        }
        for (const gap::Block& block : blocks) pointers.push_back(&block);
    }
};

gap::ModelShape one_equation() {
    gap::ModelShape shape;
    shape.amounts = {{{2}}, {{3}}};
    shape.turning = false;
    return shape;
}

constexpr Eigen::Index kAt = 5;  // of the amount among a fit's values

}  // namespace

TEST_GROUP(GapFit){};

// Where the blocks disagree by more than their noise, and few tell: the plain sandwich has a third of the
// variance too little with three of them.
TEST(GapFit, standard_errors_are_honest_where_few_blocks_tell) {
    for (const int acting : {24, 6, 3}) {
        constexpr int kTries = 1000;
        double told = 0;
        double squares = 0;
        for (unsigned seed = 1; seed <= kTries; ++seed) {
            const Experiment e(seed, acting, 1.0);
            const gap::Fit f = gap::fit(e.pointers, one_equation());
            told += f.covariance(kAt, kAt);
            squares += std::pow(f.value(kAt) - kAmount, 2);
        }
        std::printf("  effect in %d of 24 blocks: variance told over real %.2f\n", acting, told / squares);
        CHECK(told / squares > 0.85 && told / squares < 1.2);
    }
}

TEST(GapFit, the_blocks_that_tell_of_a_value_are_counted) {
    for (const int acting : {24, 6, 1}) {
        const gap::Fit f = gap::fit(Experiment(3, acting).pointers, one_equation());
        CHECK(f.telling(2) > 18 && f.telling(2) < 24.1);
        CHECK(f.telling(kAt) > 0.75 * acting && f.telling(kAt) < acting + 0.1);
    }
}

// A friction that is too small to be named is in the others: as far as it would move them they are unknown.
TEST(GapFit, what_is_left_out_widens_what_it_stands_in) {
    const Experiment e(9, 24);
    gap::BlockSet set;
    set.blocks = e.blocks;
    set.wheel_power = Eigen::MatrixXd::Zero(4, 4);
    for (gap::Block& block : set.blocks) {  // the torque has some of the column in it
        block.row[gap::kLinear].col(1) += 0.5 * block.row[gap::kLinear].col(3);
        block.product[gap::kLinear] = block.row[gap::kLinear].transpose() * block.row[gap::kLinear];
    }
    gap::ModelShape without = one_equation();
    without.amounts.pop_back();
    const gap::Fit with = gap::fit(gap::pointers(set), one_equation());
    const gap::Fit fit = gap::fit(gap::pointers(set), without);
    CHECK(with.value(kAt) < 0);  // as if it drove: it is no friction
    const std::vector<gap::Amount> friction{{{3}}};
    const double apart = gap::misfit_covariance(set, {}, fit, {}, friction)(2, 2) -
                         gap::misfit_covariance(set, {}, fit, {}, {})(2, 2);
    DOUBLES_EQUAL(0, apart, 1e-12);
    for (gap::Block& block : set.blocks) {
        block.row[gap::kLinear].col(3) *= -1;
        block.product[gap::kLinear] = block.row[gap::kLinear].transpose() * block.row[gap::kLinear];
    }
    const double moved = with.value(2) - fit.value(2);
    DOUBLES_EQUAL(moved * moved,
                  gap::misfit_covariance(set, {}, fit, {}, friction)(2, 2) -
                      gap::misfit_covariance(set, {}, fit, {}, {})(2, 2),
                  0.05 * moved * moved);
}

TEST(GapFit, what_one_block_tells_has_the_error_of_its_rows) {
    const Experiment e(5, 1);
    const gap::Fit f = gap::fit(e.pointers, one_equation());
    const double column = e.blocks.front().product[gap::kLinear](3, 3);
    DOUBLES_EQUAL(1 / (kGain * std::sqrt(column)), f.error(kAt), 0.15 / (kGain * std::sqrt(column)));
}

TEST(GapFit, a_size_that_is_expected_holds_what_no_block_tells) {
    const Experiment e(7, 0);
    gap::ModelShape shape = one_equation();
    shape.amounts[1].expected = 0.02;
    const gap::Fit f = gap::fit(e.pointers, shape);
    CHECK(std::abs(f.value(kAt)) < 0.02);
    DOUBLES_EQUAL(kGain, f.value(2), 4 * f.error(2));
}

TEST(GapFit, two_fits_part_where_a_column_acts_that_one_of_them_lacks) {
    constexpr int kActing = 10;
    const Experiment e(11, kActing);
    const gap::Fit with = gap::fit(e.pointers, one_equation());
    gap::Fit without = with;
    without.shape.amounts.pop_back();
    without.value.conservativeResize(kAt);
    for (int b = 0; b < 24; ++b) {
        const gap::Block& block = e.blocks[std::size_t(b)];
        const double acts = with.value(2) * with.value(kAt) * block.row[gap::kLinear].col(3).norm();
        DOUBLES_EQUAL(acts * acts, gap::squares_apart(block, with, without), 1e-9);
        if (b >= kActing) DOUBLES_EQUAL(0, gap::squares_apart(block, with, without), 1e-9);
    }
}

// Named by the signs of what it foretells beside what is left; by those of what is gained it is named less
// often than the level says where it is not there, and where it is.
TEST(GapFit, an_effect_agrees_with_what_is_left_where_it_is_there) {
    constexpr double kLevel = 0.05;
    constexpr int kTries = 500;
    gap::ModelShape without = one_equation();
    without.amounts.pop_back();
    const auto named = [&](double mean, bool by_gain) {
        double times = 0;
        for (unsigned seed = 1; seed <= kTries; ++seed) {
            const Experiment e(seed, 8, 0, 0, mean);
            const gap::Sample sample(e.pointers);
            const auto left_out = [&](const gap::ModelShape& shape) {
                gap::LeftOut made;
                for (const gap::Block& rest : sample.rest)
                    made.rest.push_back(gap::fit({&rest}, shape, gap::Spread::none));
                for (std::size_t i = 0; i < sample.size(); ++i)
                    made.squares.push_back(gap::squares(*sample.blocks[i], made.rest[i % made.rest.size()]));
                return made;
            };
            const gap::LeftOut bare = left_out(without);
            const gap::LeftOut more = left_out(one_equation());
            std::vector<double> values = gap::agreement(sample, bare, more);
            if (by_gain) {
                values.clear();
                for (std::size_t i = 0; i < sample.size(); ++i)
                    values.push_back(bare.squares[i] - more.squares[i]);
            }
            times += gap::signed_sum_probability(values) <= kLevel ? 1.0 : 0.0;
        }
        return times / kTries;
    };
    const double by_chance = named(0, false);
    const double there = named(0.15, false);
    const double gained = named(0.15, true);
    std::printf("  named at 5 %%: %.3f of what is not there, %.2f of what is (by its gain: %.3f, %.2f)\n",
                by_chance, there, named(0, true), gained);
    // a little more than the level: what foretells the blocks is fitted to nearly the same others
    CHECK(by_chance > 0.02 && by_chance < 2 * kLevel);
    CHECK(there > gained + 0.1);
}

TEST(GapFit, beyond_noise_is_the_torque_that_is_missing) {
    const Experiment e(9, 24);
    gap::ModelShape shape = one_equation();
    shape.amounts.pop_back();
    // the column's power is a ninth of the torque's
    DOUBLES_EQUAL(kAmount / 3, gap::beyond_noise(e.pointers, gap::fit(e.pointers, shape)).share_of_torque(),
                  0.02);
    DOUBLES_EQUAL(0, gap::beyond_noise(e.pointers, gap::fit(e.pointers, one_equation())).share_of_torque(),
                  0.02);
}

TEST_GROUP(GapRefine){};

namespace {

// A robot with one effect, driven; and a fit of K5..K8, a timing and the effect's amount, that is off.
struct Off {
    test::HiddenLog hidden;
    std::size_t effect;
    gap::LogPart part{&hidden.log, 0, 0, hidden.log.samples.size(), 0, nullptr};
    std::vector<gap::Stretch> pieces = gap::stretches(std::span(&part, 1), 5, hidden.geometry);
    gap::Fit weak{};

    Off(const test::HiddenLog& log, std::string_view name, const gap::Amount& columns,
        const std::array<double, 5>& k_and_amount)
        : hidden(log), effect(model::find_effect(name)) {
        weak.shape.amounts = {{{2}}, columns};
        const auto& [k5, k6, k7, k8, amount] = k_and_amount;
        weak.value = Eigen::VectorXd::Zero(6);
        weak.value << k5, k6, k7, k8, 0, amount;
        weak.covariance = Eigen::MatrixXd::Zero(6, 6);
    }
    Off(const Off&) = delete;
    Off& operator=(const Off&) = delete;

    std::optional<gap::Refined> refined(const gap::Fit& from, double small_rad_per_s) const {
        const auto robot_of = [this](const gap::Fit& f) {
            gap::SimulatedRobot robot;
            robot.geometry = hidden.geometry;
            robot.dynamics = {f.value(0), f.value(1), f.value(2), f.value(3)};
            robot.effects.active[effect] = true;
            for (std::size_t i = 0; i < model::kEffects[effect].parameters.size(); ++i)
                robot.effects.parameter[effect][i] = f.value(kAt);
            return robot;
        };
        const auto found = gap::refine_by_free_run(from, pieces, small_rad_per_s, robot_of);
        if (found) {
            std::printf("  free run %.3g -> %.3g rad/s, friction %.4f +- %.4f\n", found->weak_rad_per_s,
                        found->rad_per_s, found->fit.value(kAt), found->fit.error(kAt));
        }
        return found;
    }
};

}  // namespace

// K5..K8 of a robot like it, and half of the friction.
TEST(GapRefine, free_runs_bring_a_fit_that_is_off_back_to_the_truth) {
    const Off off(test::hidden_log({"viscous_friction", 0, {0.03, 0.03}}, 4, 0.01, 20, 100),
                  "viscous_friction", {{3, 4}}, {0.03, -1.0, 1.0, 5.0, 0.015});
    const auto refined = off.refined(off.weak, 0.001);
    CHECK(refined.has_value());
    DOUBLES_EQUAL(0.01, refined->rad_per_s, 0.003);
    DOUBLES_EQUAL(0.03, refined->fit.value(kAt), 0.002);
    CHECK(!off.refined(refined->fit, 0.1).has_value());
}

// Where friction holds the robot at times, the misses jump with every parameter: slopes over small moves lead
// nowhere.
TEST(GapRefine, free_runs_of_a_robot_that_sticks_reach_the_noise) {
    const Off off(test::hidden_log({"turning_scrub", 0, {0.6}}, 4, 0.05, 40, 100), "turning_scrub", {{3}},
                  {0.038, -1.0, 1.02, 5.1, 0.63});
    const auto refined = off.refined(off.weak, 0.001);
    CHECK(refined.has_value());
    DOUBLES_EQUAL(0.05, refined->rad_per_s, 0.005);
    CHECK(refined->fit.error(kAt) < 0.001);
    DOUBLES_EQUAL(0.6, refined->fit.value(kAt), 3 * refined->fit.error(kAt));
}

TEST(GapRefine, a_free_run_that_begins_midway_knows_what_the_tyres_slip) {
    gap::SimulatedRobot robot;
    robot.geometry = {{0.0743, 0.0743}, 0.327};
    robot.dynamics = {0.04, model::coupled_k6(0.04, 1.31, 6.1, 0.327), 1.31, 6.1};
    const std::size_t slip = model::find_effect("wheel_slip");
    robot.effects.active[slip] = true;
    robot.effects.parameter[slip] = {0.9, 1.1};
    sim::Plant plant(sim::plant_from_dynamics(robot.geometry, robot.dynamics, robot.effects));
    tools::MeasuredLog log;
    log.period_s = 0.004;
    for (int i = 0; i < 1000; ++i) {
        const double t = i * log.period_s;
        const WheelPair<double> torque{0.4 * std::sin(9 * t), 0.5 * std::sin(7 * t)};
        log.samples.push_back({t, torque, plant.wheel_speed_rad_per_s()});
        for (int step = 0; step < 8; ++step) plant.advance(log.period_s / 8, torque);
    }
    for (const std::size_t first : {0U, 3U, 500U}) {
        const gap::Stretch stretch{&log, first, log.samples.size(), 0};
        const double squares = gap::free_run(robot, stretch, log.samples[first].speed_rad_per_s);
        const double rms = std::sqrt(squares / (2.0 * double(log.samples.size() - first)));
        std::printf("  free run from sample %zu: %.1e rad/s\n", first, rms);
        CHECK(rms < 0.002);
    }
}

TEST_GROUP(GapMisfit){};

// A right model is found alike with every weighting, so that its errors stay about what they are; of one
// whose amount depends on the frequency the interval reaches what the slow and the quick half of the rows
// say.
TEST(GapMisfit, errors_grow_with_what_the_model_leaves_out_alone) {
    for (const double rising : {0.0, 0.3}) {
        constexpr int kTries = 200;
        double told = 0;
        double more = 0;
        for (unsigned seed = 1; seed <= kTries; ++seed) {
            const Experiment e(seed, 24, 0, rising);
            gap::BlockSet set;
            set.blocks = e.blocks;
            set.wheel_power = Eigen::MatrixXd::Zero(4, 4);
            const gap::Fit f = gap::fit(e.pointers, one_equation());
            told += f.covariance(kAt, kAt) / kTries;
            more += gap::misfit_covariance(set, {}, f, {}, {})(kAt, kAt) / kTries;
        }
        if (rising == 0) {
            CHECK(more < 2 * told);
        } else {
            // the halves' amounts lie a quarter of the rise to either side
            CHECK(1.96 * std::sqrt(told + more) > rising / 4);
            CHECK(1.96 * std::sqrt(told) < rising / 4);
        }
    }
}
