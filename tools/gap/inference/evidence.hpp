// What lists of effects explain of the blocks, and whether one surely explains more than another: the fits
// and tests that the search (search.cpp) and what is said of its outcome (outcome.hpp) stand on.
// Nothing here decides.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "tools/gap/inference/search.hpp"

namespace wheelwright::gap {

// Likeness in a log above which no log like it separates two effects.
inline constexpr double kConfounded = 0.999;

// A fit with these in it as far as they come out as friction; one that drives is none.
Fit fit_beside_friction(const Blocks& blocks, ModelShape shape, const std::vector<Amount>& frictions);

// A member's parameters, in the catalogue's order and units, of a fit to so many blocks.
std::vector<ParameterEstimate> parameters_in(const Members& members, std::size_t member, const Fit& fit,
                                             const Setting& setting, std::size_t blocks);

// Puts down the point at which a member that is not linear fits best.
void note_point(const Members& members, std::size_t member, const Fit& fit, const Setting& setting,
                Points& points);

// Of the torque, that the torque of the members' last is to be.
double least_share(const Members& members, const Candidate& candidate);

// That a candidate of these amounts is not there. One that may not be less than nothing has one side.
double probability_of_none(const Candidate& candidate, const Eigen::VectorXd& amounts,
                           const Eigen::MatrixXd& covariance, double degrees, const Setting& setting);

// The amounts at `at` and behind it differ by more than chance; the variance of their difference.
bool apart(const Fit& fit, Eigen::Index at);
double difference_variance(const Fit& fit, Eigen::Index at);

// The first of each block's squares are less than the second, by more than chance and by more than a trifle.
bool surely_less(const std::vector<double>& first, const std::vector<double>& second);

// Two models' squares, block by block, left out of the fit: of the blocks in which the models predict
// something different. In others noise would judge between them.
struct Compared {
    std::vector<double> one, other;
};

// Blocks that are fitted to together, and what sums of theirs stand for: a fit without errors is as quick as
// one to a single block.
struct Sample {
    // The blocks must outlive it.
    explicit Sample(Blocks of);
    std::size_t size() const { return blocks.size(); }

    Blocks blocks;
    Block whole;
    std::vector<Block> rest;  // without every kFolds-th from the first, the second, ... on
};

// Of blocks, each left out of the fit to the others of its Sample::rest: those fits, and each block's
// squares.
struct LeftOut {
    std::vector<Fit> rest;
    std::vector<double> squares;
};

// By block, how far what the second model foretells beside the first agrees with what the first leaves there:
// the product of their rows. Of what is not there it is as often less than nothing as more. The second errs
// less from twice as much on: that it foretells too much of what is there, as few blocks may make it, would
// count against it.
std::vector<double> agreement(const Sample& sample, const LeftOut& first, const LeftOut& second);

// A candidate of an effect, and what a fit with it leaves of the blocks that it was fitted to. Left out of
// the fit they can but leave more.
struct BestPoint {
    Candidate candidate;
    double squares;
};

class Evidence {
  public:
    // Both must outlive it. Costs one fit.
    Evidence(const BlockSet& train, const SearchOptions& options);

    const BlockSet& set() const { return set_; }
    const Sample& all() const { return all_; }
    const SearchOptions& options() const { return options_; }
    const Dictionary& dictionary() const { return *options_.dictionary; }
    const Members& base() const { return base_; }  // effects of the model, before any is found
    const Fit& base_fit() const { return base_fit_; }
    // The friction that every drive train may have, as far as the model does not have it and the log holds
    // something of it: beside it K7 and K8 are fitted, and all else is looked for.
    const Members& friction() const { return friction_; }
    // What of it is there.
    void set_friction(Members friction) { friction_ = std::move(friction); }
    double rows() const { return rows_; }

    // The forms in which an effect may enter; those with fewer unknowns first.
    std::vector<Candidate> candidates(std::size_t effect) const;
    // Known not to be there; and also what is not to be named.
    bool impossible(std::size_t effect) const;
    bool excluded(std::size_t effect) const;
    // This log holds something of it.
    bool excited(const Candidate& candidate) const;

    ModelShape shape_of(const Members& members) const;
    // Costs as much as any fit (fit.hpp); what judges below costs some of them.
    Fit fit(const Sample& sample, const Members& members, Spread spread = Spread::known) const;
    // A fold with a launch may tell more of K7 than all the others: then with the K7 of all pieces, for a
    // part is to tell of effects only; so with K8.
    Fit fit_of_part(const Sample& part, const Members& members) const;

    LeftOut left_out(const Sample& sample, const Members& members) const;
    // With an effect beside the members, of which each fit chooses the point anew: a block left out takes no
    // part in that either. Where none is in range the fit is without it.
    LeftOut left_out_with(const Sample& sample, const Members& members, std::size_t effect) const;
    // Squares of each block, left out of the fit; and their sum.
    std::vector<double> squares_left_out(const Sample& sample, const Members& members) const {
        return left_out(sample, members).squares;
    }
    double cross_validated(const Sample& sample, const Members& members) const;
    // What a model with free coefficients for everything smooth leaves, on blocks it was not fitted to.
    double reach(const Sample& sample, const Members& members) const;

    // As the RMS of torque that would do the same, over the RMS of the torque: a gap, and a member.
    double torque_share(double gap) const;
    double effect_torque_share(const Members& members, std::size_t member, const Fit& fit) const;

    // The last member is within its physical range: a friction that drives is none. `fit`: of the members to
    // the sample. Costs another where errors decide and it has none.
    bool in_range(const Sample& sample, const Members& members, const Fit& fit) const;
    // That the last member is not there. A linearised one is taken as a whole for it.
    double probability_of_last(const Sample& sample, const Members& members) const;
    // The best of an effect's points in range, beside the members.
    std::optional<BestPoint> best_point(std::size_t effect, const Members& members,
                                        const Sample& sample) const;

    Compared compared(const Members& one, const Members& other) const;
    Compared compared(const Compared& all, const Members& one, const Members& other) const;
    // One model is true rather than the other, by all that they predict.
    bool distinguishes(const Members& one, const Members& other) const;
    // Surely one rather than the other, by either.
    bool better(const Members& one, const Members& other) const;

    // What a rival is tried beside: the others as they are; and with left and right of each apart, for what
    // is named instead of the rival may have hidden that they differ.
    std::vector<Members> others_for(const Members& fewer) const;

  private:
    ModelShape shape_for_part(const Members& members) const;
    Fit base_usually() const;

    const BlockSet& set_;
    const SearchOptions& options_;
    Sample all_;
    Members base_, friction_;
    Fit base_fit_, usual_fit_;  // usual: beside friction
    std::array<bool, kEquations> one_tells_{};
    double rows_ = 1;
};

}  // namespace wheelwright::gap
