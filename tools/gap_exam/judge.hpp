// What an answer of the analysis is worth, held against the truth of the log.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tools/gap_bench/gap_answer.hpp"
#include "tools/gap_exam/truth/exam_log.hpp"

namespace wheelwright::exam {

// Effects that no number of the motion would show are not asked for.
inline constexpr double kVisible = 0.01;  // of the torque, beside K5..K8 and the frictions

// Why a further effect of the catalogue is not among the names, by what the answer says it has tried.
enum class Miss {
    unseen,     // by its likelihood ratio beside friction no one could be sure of it
    stood_for,  // sure beside friction, but not beside what is named: that does the same here
    denied,     // found, and denied: by the free run or by other weightings of the rows
    not_taken,  // sure beside what is named, by all rows: not by the pieces
    not_tried,  // no point of it was in range
};
// `level`: the likelihood ratio's, after Bonferroni over the catalogue.
inline constexpr double kOracleLevel = 0.01;
Miss miss_of(std::string_view effect, const bench::GapAnswer& answer);

struct Covered {
    std::string what;  // "k7_per_kg_m", "slope.angle_rad"
    bool holds = false;
};

struct Judged {
    // Of the further effect: named, confounded (a rival of what is named), or missing. Of one that is in no
    // catalogue: named is "unexplained", confounded is a name that has rivals.
    bench::Held dry = bench::Held::missing, viscous = bench::Held::missing, further = bench::Held::missing;
    std::vector<std::string> wrong;  // names of what is not there, without a rival that is
    bool complete = false;           // all that is there and visible is named, and nothing is wrong
    std::vector<Covered> intervals;
    // Held-out free run over the true robot's, both wheels. Refused: infinite. Not a number where they cannot
    // be compared.
    double over_true = 0;
};

Judged judge(const ExamLog& log, const bench::GapAnswer& answer);

}  // namespace wheelwright::exam
