// What an answer of the analysis is worth, held against the truth of the log.
#pragma once

#include <string>
#include <vector>

#include "tools/gap_bench/gap_answer.hpp"
#include "tools/gap_exam/truth/exam_log.hpp"

namespace wheelwright::exam {

// Effects that no number of the motion would show are not asked for.
inline constexpr double kVisible = 0.01;  // of the torque, beside K5..K8 and the frictions

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
