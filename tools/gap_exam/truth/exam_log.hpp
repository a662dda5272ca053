// One log of the exam with the truth behind it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/gap_exam/truth/drive.hpp"

namespace wheelwright::exam {

// RMS of the torque that something takes in a log, over both wheels, as a share of the commanded torque's
// RMS; and what of that is left when K5..K8 and the frictions (other than itself) have taken up what they
// can.
struct Size {
    double share = 0, visible = 0;
};

// What means the same in the truth and in gap.json. K5..K8 have no effect.
struct Parameter {
    std::string effect, name;
    double value = 0;
};

struct ExamLog {
    std::size_t number = 0;
    Robot robot;
    Sensors sensors;
    Driving driving;
    Drive learned, held_out;
    Size dry, viscous, further;
    double ground_share = 0;
    double late_s = 0;              // of the speeds behind the commands, all delays and lags together
    double true_rms_rad_per_s = 0;  // see true_free_run_rms, of the held-out drive
    bool comparable = true;         // false: what comes or goes with time is elsewhere in another drive
    std::vector<Parameter> parameters;
};

// The same for a seed and a number, whatever else is drawn.
ExamLog draw_log(std::uint64_t seed, std::size_t number);

// As gap.json would have it; of the log's friction the least-squares equivalent, of the further effect what
// is defined by a number.
std::vector<Parameter> true_parameters(const Robot& robot, const Drive& drive);

struct Sizes {
    Size dry, viscous, further;
    double ground_share = 0;
};
Sizes sizes_in(const Robot& robot, const Drive& drive);

// The truth, as JSON.
std::string truth_json(const ExamLog& log);

}  // namespace wheelwright::exam
