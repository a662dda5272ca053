// The last part of the demo: a simulated robot that hides an effect, found from the log of its bus.
#pragma once

#include <cstdint>
#include <string>

#include "tools/cli/report.hpp"
#include "tools/gap/analysis.hpp"
#include "tools/sim/experiments.hpp"

namespace wheelwright::tools {

struct HiddenEffect {
    std::size_t effect = 0;  // drawn
    // Its true values, as a model with the file's wheel radii sees them.
    model::Parameters<double> parameters{};
    double driven_s = 0;
    gap::Request request;
    gap::Findings findings;  // with the figure-8 before and after
    std::string problem;     // why it came to nothing

    // Draws the effect, drives the robot that has it (virtual time), writes the bus to FOLDER/drive.log, and
    // analyses that log alone; beside it gap.json, robot.extended.toml and report.html.
    void run(const task::RobotFile& robot, const std::string& robot_path, const task::RobotFile& plant,
             std::uint64_t seed, const std::string& folder, const Progress& progress);

    bool found() const;  // exactly this effect was named
    bool reached_its_aims() const;
    std::string name() const;
    void add_to(Report& report) const;
};

}  // namespace wheelwright::tools
