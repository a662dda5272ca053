// One split of measured logs into what is learned from and what is held out, and what each method makes of
// it.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "tools/cli/progress_line.hpp"
#include "tools/gap_bench/corpus.hpp"
#include "tools/gap_bench/gap_answer.hpp"

namespace wheelwright::bench {

// Held-out free runs: RMS of simulated less measured wheel speed, mean of both wheels, rad/s.
struct Split {
    std::string robot;            // of the corpus; or the log
    std::string held_out;         // the run; or the share that was learned from
    std::string unusable;         // the held-out log cannot be used; then nothing below is set
    double signal_rad_per_s = 0;  // RMS of the measured speed itself
    double torque_alone_rad_per_s = 0, sysid_rad_per_s = 0, plain_rad_per_s = 0;
    GapAnswer gap;
    Published published;

    // Refused: infinite.
    double gap_over_sysid() const { return gap.rms_rad_per_s / sysid_rad_per_s; }
};

struct BenchOptions {
    std::string program;               // whose `gap` is asked
    std::vector<std::string> reading;  // options for it that say how logs are read
    std::string out;                   // folder for what it writes
    std::size_t jobs = 1;
};

using Progress = std::function<void(const tools::CampaignProgress&)>;

// Every run that goes forward is held out once, and the robot's others of that kind are learned from.
std::vector<Split> leave_one_run_out(const Corpus& corpus, const BenchOptions& options,
                                     const Progress& progress);

// Of one log, the first share is learned from, in percent.
std::vector<Split> split_one_log(const CorpusRun& run, const model::Geometry<double>& geometry,
                                 const std::vector<double>& percents, const BenchOptions& options,
                                 const Progress& progress);

}  // namespace wheelwright::bench
