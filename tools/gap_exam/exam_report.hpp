// The exam's curves, figures and aims.
#pragma once

#include <vector>

#include "tools/gap_bench/bench_report.hpp"
#include "tools/gap_exam/exam.hpp"

namespace wheelwright::exam {

std::vector<bench::Aim> exam_aims(const std::vector<Answered>& answers);
tools::Report exam_report(const std::vector<Answered>& answers);

}  // namespace wheelwright::exam
