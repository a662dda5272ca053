// Evaluations of the same logs, one after the other: each is a search, with columns made where the one before
// found something. Which there are, and when one is taken back; their order is the analysis'.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "tools/gap/inference/search.hpp"
#include "tools/gap/inference/sensor_evidence.hpp"
#include "tools/gap/logs/experiment.hpp"
#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {

// What is evaluated, and what is known of it before.
struct EvaluationOptions {
    model::Geometry<double> geometry;
    model::EffectSet<double> base;  // that the given model has
    Overview overview;
    Parts parts;  // of logs that outlive the evaluations
    Known known;
};

// An evaluation: the dictionary, the blocks that were made with it and how they are weighed, and what was
// found.
struct Evaluation {
    Search search;
    Dictionary dictionary;
    BlockSet train;
    Colour colour;
};

// first_model() comes first, and nothing after it if it has a problem.
class Evaluations {
  public:
    explicit Evaluations(EvaluationOptions options);
    Evaluations(const Evaluations&) = delete;
    Evaluations& operator=(const Evaluations&) = delete;

    // K5..K8 without anything that the given model does not have: columns are made with them. The text: why
    // these logs cannot be searched.
    std::optional<std::string> first_model();

    // Begins again after first_model(), with an effect that is a rival at most.
    void deny(std::size_t effect);

    // At everything, over the same blocks and columns as the last time.
    void evaluate();
    // Columns may depend on K5..K8 (a slope's do), which what was missing had spoilt, and on where an effect
    // that is not linear was looked for. The first `broad` ones have everything in the catalogue.
    void evaluate_closer(int broad);

    // The torques turn the robot: the turning equation is used.
    bool turning() const { return turning_; }
    // Pieces of the logs that the first model was fitted to.
    std::size_t blocks() const { return blocks_; }
    // What is known, by now.
    const Known& known() const { return options_.known; }
    // The last one that was kept.
    const Evaluation& last() const { return *current_; }
    // Of the held-out part, with the columns of the last one; none without one. Made at each call.
    BlockSet held_out() const;
    // For another dictionary, with K5..K8 of the last one and points as close together.
    Setting setting_found() const;
    // For other blocks of the parts learned from; what is kept for them is in here.
    const BlockOptions& block_options() const { return block_options_; }

  private:
    model::Dynamics<double> dynamics_found() const;
    Setting setting_for(const model::Dynamics<double>& dynamics) const;
    Evaluation put_aside();
    void make(const model::Dynamics<double>& dynamics, Points points, bool starts);
    bool turned_with_an_effect(const Fit& without) const;
    void space_events_closer();
    bool near_enough() const;

    EvaluationOptions options_;
    KeptColumns kept_;
    BlockOptions block_options_;
    bool driving_ = true, turning_ = false;
    std::optional<double> k7_per_kg_m_;  // held, as nothing drives
    std::size_t blocks_ = 0;
    WheelFriction friction_;  // found by now
    int refinements_ = 0;
    double event_spacing_s_ = 0;
    std::optional<Evaluation> current_, first_;  // first: as it was before anything was looked for
};

}  // namespace wheelwright::gap
