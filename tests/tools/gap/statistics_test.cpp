// The search's tests against published tables and against draws of which the truth is known.
#include "tools/gap/inference/statistics.hpp"

#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr double kSignificance = 0.01;
constexpr int kBlocks = 20;
constexpr int kDraws = 2000;

// Gains of a model over another in blocks that foretell them `apart` on the whole, block by block more: the
// first is true (+1), the other (-1), or neither (0). `disagree`: by how much the truth differs between
// blocks. In all but the last `telling` of them the two foretell nearly the same.
struct Draw {
    std::vector<double> gain, apart;

    Draw(std::mt19937& engine, double all_apart, double truth, double disagree = 0, int telling = kBlocks) {
        constexpr double kHardly = 1e-3;
        std::normal_distribution<double> normal;
        for (int b = 0; b < kBlocks; ++b) {
            const double one =
                all_apart * 2 * (b + 1) / (kBlocks * (kBlocks + 1)) * (b < kBlocks - telling ? kHardly : 1);
            apart.push_back(one);
            gain.push_back((truth + disagree * normal(engine)) * one + 2 * std::sqrt(one) * normal(engine));
        }
    }
};

double share_of_draws_distinguished(double all_apart, double truth, double disagree = 0,
                                    int telling = kBlocks) {
    std::mt19937 engine(5);
    int distinguished = 0;
    for (int i = 0; i < kDraws; ++i) {
        const Draw draw(engine, all_apart, truth, disagree, telling);
        distinguished += gap::surely_as_predicted(draw.gain, draw.apart, 1, kSignificance) ? 1 : 0;
    }
    return double(distinguished) / kDraws;
}

}  // namespace

TEST_GROUP(GapStatistics){};

// Tables of Student's t and of Wilcoxon's signed ranks (n = 8: a sum of 5 or less has 3.9 % one-sided).
TEST(GapStatistics, agree_with_the_tables) {
    DOUBLES_EQUAL(0.05, gap::t_probability(2.228, 10), 1e-4);
    DOUBLES_EQUAL(0.01, gap::t_probability(2.845, 20), 1e-4);
    DOUBLES_EQUAL(1.0 / 32, gap::signed_rank_probability({1, 2, 3, 4, 5}), 1e-12);
    DOUBLES_EQUAL(10.0 / 256, gap::signed_rank_probability({1, 2, 3, 4, -5, 6, 7, 8}), 1e-12);
}

// Of 2^n draws of the signs those with as large a sum are counted by hand: {5, 4, 1, -1}, {5, 4, 1, 1} and
// {5, 4, -1, 1} of 16.
TEST(GapStatistics, signs_drawn_anew_make_a_sum_as_large) {
    DOUBLES_EQUAL(1.0 / 32, gap::signed_sum_probability({1, 2, 3, 4, 5}), 1e-12);
    DOUBLES_EQUAL(3.0 / 16, gap::signed_sum_probability({5, 4, 1, -1}), 1e-12);
    DOUBLES_EQUAL(1, gap::signed_sum_probability({}), 0);
    DOUBLES_EQUAL(1, gap::signed_sum_probability({0, 0}), 0);
}

// Five pieces in which an effect acts are not outvoted by fifteen in which it does not; one alone is never
// sure.
TEST(GapStatistics, large_values_count_as_large) {
    std::vector<double> values(15, 0.05);
    for (std::size_t i = 0; i < values.size(); i += 2) values[i] = -0.1;
    values.push_back(100);
    CHECK(gap::signed_sum_probability(values) > 0.4);
    values.insert(values.end(), {90, 110, 80, 120, 100, 95});
    CHECK(gap::signed_sum_probability(values) < 0.01);
    CHECK(gap::signed_rank_probability(values) > 0.01);
}

TEST(GapStatistics, what_is_not_there_is_sure_as_seldom_as_asked) {
    std::mt19937 engine(7);
    std::normal_distribution<double> normal;
    int sure = 0;
    for (int i = 0; i < kDraws; ++i) {
        std::vector<double> values;
        for (int b = 0; b < kBlocks; ++b) values.push_back(normal(engine) * std::exp(normal(engine)));
        sure += gap::signed_sum_probability(values) <= 0.05 ? 1 : 0;
    }
    CHECK(sure > 0.04 * kDraws && sure < 0.06 * kDraws);
}

TEST(GapStatistics, what_is_predicted_and_comes_distinguishes) {
    CHECK(share_of_draws_distinguished(30, 1) > 0.95);
    // too little is foretold for noise to let it be seen
    CHECK(share_of_draws_distinguished(1, 1) < 0.1);
}

TEST(GapStatistics, the_other_model_is_hardly_ever_taken_for_the_true_one) {
    for (const double all_apart : {1.0, 4.0, 10.0, 30.0, 1000.0})
        CHECK(share_of_draws_distinguished(all_apart, -1) < kSignificance);
    // nor is it where the truth lies half way between them, and is seen well
    CHECK(share_of_draws_distinguished(1000, 0) < kSignificance);
}

TEST(GapStatistics, blocks_that_disagree_are_believed_less) {
    CHECK(share_of_draws_distinguished(1000, -0.3, 3) < share_of_draws_distinguished(1000, 0.5, 0));
    CHECK(share_of_draws_distinguished(1000, -1, 3) < 2 * kSignificance);
}

// The others say nothing of how far those few disagree.
TEST(GapStatistics, where_few_blocks_tell_they_count_as_few) {
    for (const int telling : {1, 2, 3, 4, 6}) {
        const double wrong = share_of_draws_distinguished(1000, -1, 2, telling);
        std::printf("of 20 blocks %d tell and disagree: the other model taken for true in %.1f %% of draws\n",
                    telling, 100 * wrong);
        CHECK(wrong < 2 * kSignificance);
        CHECK(share_of_draws_distinguished(1000, -1, 0, telling) < kSignificance);
    }
    CHECK(share_of_draws_distinguished(1000, 1, 0, 6) > 0.95);
}
