// Figs 20, 21 as the paper drives them: its pose law (74)-(83) behind the point that moves along the
// figure-8, its velocity loops (65)-(72), its linearisation (62), odometry alone. No bus, no noise, no
// friction, no delay: what differs from the reference is the law's and the odometry's own.
#pragma once

#include <vector>

#include "firmware/control/trajectory.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::paper {

// Gains of (82) and (83) with which the law converges within ten seconds, beside lambda3 / lambda2 = 3.
inline constexpr double kPaperGamma1_per_s = 1;
inline constexpr double kPaperGamma2_per_s = 3;

struct DrivenSample {
    double time_s = 0;
    Pose<double> reference;
    Pose<double> truth;
    Pose<double> believed;  // odometry
    double error_m = 0;     // truth against the reference point at that time
};

struct PaperDrive {
    std::vector<DrivenSample> samples;  // a hundred a second
    double rms_m = 0;                   // from judge_from_s on
    double peak_m = 0;
    double along_m = 0;           // mean lag behind the reference point, by the robot's own odometry
    double across_m = 0;          // mean distance beside the reference path, likewise
    double odometry_error_m = 0;  // at the end
    double reverse_share = 0;     // of the time after judge_from_s driven backwards
};

struct PaperDriveOptions {
    bool forward = false;  // true: the mirrored law
    control::PathSettings<double> path;
    Pose<double> start{0, 1, 0};
    double duration_s = 42;
    double judge_from_s = 12;
};

// `believed` gives gains and the geometry of odometry and controller; `truth` the robot. Friction of the
// truth is left out, and K5..K8 are taken as known.
PaperDrive drive_paper_law(const model::RobotParameters& believed, const model::RobotParameters& truth,
                           const PaperDriveOptions& options);

// Note 8's line: the law behind a reference that moves straight on at 0.3 m/s. Mean distances over the last
// five seconds.
struct PaperLag {
    double behind_m = 0;
    double aside_m = 0;
    bool backwards = false;
};
PaperLag paper_law_on_a_line(const model::RobotParameters& believed, const model::RobotParameters& truth,
                             bool forward);

}  // namespace wheelwright::paper
