// Which columns of regression the search has for the effects of the catalogue.
//
// An effect that is linear in its coordinates has one column for each. Any other enters at points: for each
// of a few values of its nonlinear parameters there are columns of what it does there (a starting point), and
// once it has been found, of what it does at the values found and how that changes with each parameter
// (linearised), which is a Gauss-Newton step.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/gap/hypotheses/contribution.hpp"

namespace wheelwright::gap {

// What a column's values are of, beside the log and the geometry: columns of two dictionaries that have the
// same source are the same.
struct Source {
    std::size_t effect = model::kEffectCount;  // kEffectCount: none
    std::size_t number = 0;                    // of those of an effect, or of none
    model::Parameters<double> at{};            // of an effect that is not linear
    bool operator==(const Source&) const = default;
};

struct Column {
    std::size_t effect = model::kEffectCount;
    std::string_view place;  // of a column that stands for no effect: where it would show
    // None where another dictionary's column may differ: by K5..K8, or by where an effect was found.
    std::optional<Source> source;
};

// Columns that share one unknown amount. Several columns: they are equal (left and right).
struct Amount {
    std::vector<int> columns;
    double expected = 0;  // the size that it may be expected to have; 0: nothing is known of it
    bool operator==(const Amount&) const = default;
};

// One form in which an effect may enter a model.
struct Candidate {
    enum class Kind { linear, start, linearised };
    std::size_t effect = model::kEffectCount;
    Kind kind = Kind::linear;
    std::vector<Amount> amounts;
    std::vector<int> fixed;            // columns whose coefficient is one
    model::Parameters<double> at{};    // start, linearised: the point
    std::vector<std::size_t> free;     // linearised: of each amount
    bool together = false;             // linear: left and right share one amount
    std::vector<unsigned> coordinate;  // linear: of each amount
    // start, linearised: the parameter that a log may not show, and whether this candidate leaves it open
    std::size_t hidden = model::kMaxEffectParameters;
    bool leaves_open = false;
};

// The candidate that leaves open what the log may not show: at a starting point one amount stands for all, at
// a linearised the parameter stays. None: nothing may be left open.
std::optional<Candidate> left_free(const Candidate& candidate);

// The parameters that amounts of a candidate stand for. The second says whether the amounts are plausible for
// it: a lag whose column would have to be taken ten times is another lag, or none.
std::pair<model::Parameters<double>, bool> parameters_of(const Candidate& candidate,
                                                         const Eigen::VectorXd& amounts,
                                                         const Setting& setting);

class PlaceColumns;

using Points = std::map<std::size_t, model::Parameters<double>>;

// The columns of an analysis, in their order: base, every coordinate of every linear effect, points of the
// others, and a rich set of smooth functions of motion and torque, with which the reachable floor and the
// places are found.
class Dictionary {
  public:
    // Columns that every model has.
    enum Base : int { kProduct, kTorque, kTiming, kFirstEffect };

    // `linearised`: effects that are to be refined, and from where. Without `starts` the others that are not
    // linear have no columns, which are most of the work. `places`: with the columns of places.hpp, last.
    Dictionary(const Setting& setting, const Points& linearised, bool starts = true, bool places = false);

    const Setting& setting() const { return setting_; }
    std::span<const Column> columns() const { return columns_; }
    // First and one past the last.
    std::pair<int, int> linear_columns(std::size_t effect) const { return linear_[effect]; }
    std::pair<int, int> rich_columns() const { return rich_; }
    // Of a place.
    std::vector<int> rich_columns_of(std::string_view place) const;
    std::pair<int, int> place_columns() const { return places_; }
    // Whether an effect that is not linear has columns closer than its starting points.
    bool can_linearise(std::size_t effect) const;
    // Of an effect that is not linear.
    std::span<const Candidate> candidates(std::size_t effect) const { return candidates_[effect]; }

    // Sums all columns but kProduct along a log.
    class Walker {
      public:
        // `wanted`: one for each column; take_sums() passes over the others. Empty: all are.
        explicit Walker(const Dictionary& dictionary, const std::vector<bool>& wanted = {});
        // Goes on by an interval; standing: nothing acts, but time passes.
        void step(const Interval& interval, bool standing);
        // The sums since the last time: `take(column, pair)` for each column wanted, from kTorque on.
        template <typename Take>
        void take_sums(Take&& take) {
            close();
            combine();
            for (const std::size_t i : wanted_) take(static_cast<int>(i) + kTorque, columns_[i]);
            forget();
        }
        // No sums are wanted of what passed since the last time.
        void skip() {
            close();
            forget();
        }

      private:
        void close();
        void put_together(const Interval& interval);
        void forget();
        void add(const WheelPair<double>& pair);
        void add_effects(const Interval& interval);
        void add_rich(const Interval& interval);
        void combine();

        const Dictionary& dictionary_;
        std::vector<std::unique_ptr<Contribution>> term_;  // null: not wanted
        std::array<bool, model::kEffectCount> linear_wanted_{};
        bool rich_wanted_ = false;
        std::vector<std::size_t> quick_, slow_;  // of the terms
        Interval whole_;                         // since the sums were taken
        std::size_t together_ = 0, acting_ = 0;  // intervals that are in it
        std::vector<WheelPair<double>> term_sums_, columns_;
        std::vector<std::size_t> wanted_, summed_;  // of columns_; summed_: but those of probes
        std::vector<std::size_t> probes_;           // wanted, of the dictionary's
        std::size_t at_ = 0;                        // the column that is next
        std::shared_ptr<PlaceColumns> places_;
        std::vector<WheelPair<double>> place_values_;
        WheelPair<double> slow_torque_;
        bool first_ = true;
    };

  private:
    // A column of a point: a difference of contributions.
    struct Probe {
        std::size_t plus = 0, minus = kNone;
        double scale = 1;
    };
    static constexpr std::size_t kNone = ~std::size_t{0};
    struct Term {
        std::size_t effect;
        model::Parameters<double> parameters;
    };

    // The column of the first probe; the others follow.
    std::size_t first_probe() const { return std::size_t(rich_.first) - probes_.size(); }
    std::size_t term(std::size_t effect, const model::Parameters<double>& p);
    int add(std::size_t effect, const Probe& probe, const std::optional<Source>& source = std::nullopt);
    void add_starts(std::size_t effect);
    void add_linearised(std::size_t effect, const model::Parameters<double>& at);

    Setting setting_;
    std::vector<Column> columns_;
    std::vector<std::pair<int, int>> linear_;
    std::vector<std::vector<Candidate>> candidates_;
    std::pair<int, int> rich_, places_;
    std::vector<Term> terms_;
    std::vector<Probe> probes_;
};

}  // namespace wheelwright::gap
