// One trial: what is hidden, the log that an analyst may see, and the sealed label.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tools/gap_trials/hidden/effects.hpp"
#include "tools/gap_trials/hidden/motion.hpp"
#include "tools/gap_trials/hidden/plant.hpp"
#include "tools/gap_trials/hidden/robot.hpp"

namespace wheelwright::hidden {

enum class Kind {
    single,   // one effect
    pair,     // two
    nothing,  // none
    fault,    // a damaged log
    blind,    // one effect, and a motion that hardly shows it
};
std::string_view name_of(Kind kind);

// What is drawn for a trial before any number is.
struct TrialPlan {
    std::string id;  // also the name of its files
    Kind kind = Kind::nothing;
    std::vector<std::string> effects;
    std::vector<Size> sizes;      // one for each effect
    std::size_t noise = 0;        // 0 .. kNoiseLevels - 1
    std::uint64_t seed = 0;       // of the run
    std::uint64_t stream = 0;     // of the trial
    std::vector<Motion> motions;  // empty: drawn
    double duration_s = 0;        // 0: drawn, 30, 45 or 60 s
    double rate_Hz = 0;           // 0: drawn, 100 to 1000 Hz
};

// Standard deviations of white noise.
struct Noise {
    std::string_view name;
    double speed_rad_per_s;
    double gyro_rad_per_s;
};
inline constexpr std::array<Noise, 3> kNoises{Noise{"low", 0.002, 0.002}, Noise{"middle", 0.01, 0.005},
                                              Noise{"high", 0.05, 0.02}};

struct Sample {
    double t_s = 0;
    Pair torque_Nm;        // commanded at t_s, held until the next sample
    Pair speed_rad_per_s;  // as logged: noise, counts, faults
    double gyro_rad_per_s = 0;
    Pair clean_rad_per_s;  // what the drive would report without noise, counts and faults
    double clean_gyro_rad_per_s = 0;
    PlantState truth;
};

struct Trial {
    TrialPlan plan;
    std::string plant;  // "ode"
    Robot robot;
    HiddenSet hidden;
    std::vector<double> reached;  // size of each effect, as SizeKind says
    std::vector<Motion> motions;
    double duration_s = 0;
    bool quick = false;  // with shorter bits in its prbs
    double rate_Hz = 0;
    bool gyro = false;
    double rms_torque_Nm = 0;   // commanded, both wheels
    double peak_torque_Nm = 0;  // commanded
    long complaints = 0;        // of the plant's solver
    std::vector<Sample> samples;
};

using PlantMaker = std::function<std::unique_ptr<Plant>(const Robot&, const HiddenSet&)>;

// No parameter gives an effect its size: such a robot cannot be made.
class CannotDraw : public std::runtime_error {
  public:
    using std::runtime_error::runtime_error;
};

// Draws everything that the plan leaves open and drives the robot, again and again with better fitting
// parameters until every effect has a size within its range. The same plan gives the same trial. Where a
// robot or its motions do not let an effect have its size, others are drawn; throws CannotDraw after the
// third.
Trial generate(const TrialPlan& plan, std::string_view plant_name, const PlantMaker& make_plant);

// The same robot with the same effects on the same drive, logged and commanded at another rate: what a slower
// command holds longer, the robot feels. A divisor of 2000 Hz. Without faults of the log.
Trial driven_again(const Trial& trial, double rate_Hz, const PlantMaker& make_plant);

// The same robot with the same effects, driven anew from rest through a programme, with a noise of its own.
// Effects of which the parameters tell a time or a share of the log (payload_step, gain_drift) begin anew.
// Without faults of the log.
Trial driven_through(const Trial& trial, const TorqueProgramme& programme, const PlantMaker& make_plant);

// The log as text: t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s[,gyro_z_rad_s].
std::string csv_text(const Trial& trial);

// What an oracle (oracle.hpp) says of a trial.
struct OracleVerdict {
    bool identifiable = true;
    std::string nearest_rival;    // "" with nothing hidden; "nothing" where the base model alone does as well
    double unexplained_true = 0;  // in variances of the noise
    double unexplained_none = 0;
    double unexplained_rival = 0;  // of the nearest one
};

// The sealed label as JSON: all that was drawn, what the oracle says, and under "analyst" what the analyst is
// told.
std::string label_text(const Trial& trial, const OracleVerdict& oracle);

}  // namespace wheelwright::hidden
