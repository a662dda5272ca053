// What a model is worth to the controller: the standard figure-8 on one simulated robot, driven by
// controllers that believe different things about it. The external pose is exact: what is left is the
// controller's.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::gap {

struct Findings;
struct Request;

struct FigureEight {
    bool driven = false;
    std::string stopped;  // by which fault, if by one
    double rms_m = 0, peak_m = 0;
    std::vector<double> t_s, error_m, x_m, y_m, reference_x_m, reference_y_m;  // ten a second, by the truth
};

struct ClosedLoop {
    std::string plant;  // what the simulated robot is
    bool truth_known = false;
    std::optional<FigureEight> nominal;  // as the given robot file believes
    FigureEight before;                  // K5..K8 fitted anew
    FigureEight after;                   // and the effects that were named
    std::optional<FigureEight> truth;    // for a controller that knows the truth, where there is one
};

// The robot that drives, and what each controller believes.
struct ClosedLoopSetup {
    task::RobotFile plant;
    std::optional<model::RobotParameters> nominal, truth;
    model::RobotParameters before, after;
    std::uint64_t seed = 1;
    std::function<void(const std::string&)> progress = [](const std::string&) {};
};
ClosedLoop close_loop(const ClosedLoopSetup& setup);

// Controllers that believe what was found, what was fitted without the named effects, and the given model.
// All as their robot files say (robot_files.hpp): what the log could not show is the given model's. The robot
// that drives is the one that was found, unless somebody knows the truth and puts it in `plant`. Throws
// std::runtime_error without files.
ClosedLoopSetup closed_loop_setup(const Findings& findings, const Request& request);
// Tells it: another robot drives, and one more controller knows of it all that can be known with its
// geometry.
void set_truth(ClosedLoopSetup& setup, const task::RobotFile& plant);

}  // namespace wheelwright::gap
