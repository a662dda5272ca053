// The exam: logs drawn, the analysis asked about each in a process of its own, answers judged.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/cli/progress_line.hpp"
#include "tools/gap_exam/judge.hpp"

namespace wheelwright::exam {

struct ExamOptions {
    std::uint64_t seed = 1;
    std::vector<std::size_t> numbers;  // of the logs
    std::size_t jobs = 1;
    std::string program;  // whose `gap` is asked
    std::string out;      // NUMBER/learned.csv, held_out.csv, gap/, and, after the answer, truth.json
};

struct Answered {
    ExamLog log;  // without its rows
    bench::GapAnswer answer;
    Judged judged;
};

// In the order of the numbers. Throws std::runtime_error when a file cannot be written.
std::vector<Answered> hold_exam(const ExamOptions& options,
                                const std::function<void(const tools::CampaignProgress&)>& progress);

}  // namespace wheelwright::exam
