// Every row of the paper, run once: what the page, the JSON file and the tests are made of.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "tools/cli/report.hpp"
#include "tools/paper/chain_experiments.hpp"
#include "tools/paper/driving_experiments.hpp"
#include "tools/paper/model_experiments.hpp"
#include "tools/paper/table1.hpp"
#include "tools/paper/velocity_experiments.hpp"

namespace wheelwright::paper {

// Where the evidence comes from.
enum class Through {
    model,  // this project's code on the equations, without a bus
    can,    // firmware, CAN frames, simulated drives and robot
};

// A row of the paper and its counterpart.
struct Row {
    std::string id;     // key in JSON
    std::string paper;  // equations, figures, sections
    std::string what;
    std::string aim;
    std::string measured;
    Through through = Through::model;
    bool met = false;
};

// Honesty of the intervals over many seeds of Table 1's experiment with noise, per parameter.
struct Intervals {
    std::size_t seeds = 0;
    std::array<double, 4> mean_z{}, rms_z{}, coverage{};  // coverage of +-1.96 standard errors
    std::array<double, 4> naive_rms_z{};                  // the same with the residual variance times P_ii
    bool honest = false;  // |mean| < 0.3, rms 0.8..1.25, coverage 88..99 %, each parameter
};

struct PaperLaps {
    double period_s = 0;
    PaperDrive literal;   // as printed: in reverse
    PaperDrive mirrored;  // driving forward
};

struct Reproduction {
    bool quick = false;
    std::uint64_t seed = 1;

    Table1Result table1;        // step-averaged regressors, without noise
    Table1Result table1_plain;  // the print's plain difference
    Table1Result table1_noisy;  // step-averaged, with noise, for Figs 10-17
    Intervals intervals;

    ArxResult arx_2_2, arx_4_3;
    PrecisionResult precision;
    CascadeResult cascade;
    double linearisation_error = 0;
    ArmResult arm;

    StepResponse continuous, continuous_without_zero;
    struct Delayed {
        double delay_s = 0;
        StepResponse paper;
        OurDesign design;
        StepResponse ours;
    };
    std::vector<Delayed> delayed;  // 0, 1, 2, 3 ms

    TorqueRun torque;
    CanIdentification identification;          // run until K5 and K6 are well known too
    CanIdentification default_identification;  // as the ident mode stops by the robot file's own settings
    CanStep step_ours, step_paper;
    double step_ripple = 0;  // of the settled true speed, share of the step
    std::vector<PoseDrive> poses;
    control::PathSettings<double> path;
    std::vector<PaperLaps> paper_laps;  // the reference's own lap time first, then a slow one
    PaperLag lag_literal, lag_mirrored;
    tools::TrackingResult tracking, tracking_odometry;
    AdaptationRun adaptation;

    std::vector<Row> rows;

    bool all_met() const;
};

struct ReproductionOptions {
    bool quick = false;  // fewer seeds and goals; the aims on intervals are then shown, not judged
    std::uint64_t seed = 1;
    std::function<void(const std::string& stage)> progress;
};

// Throws std::runtime_error when a robot file compiled in is not good (a mistake of the build).
Reproduction reproduce(const ReproductionOptions& options);

// The figures, for the terminal and for programs.
tools::Report report_of(const Reproduction& from);

}  // namespace wheelwright::paper
