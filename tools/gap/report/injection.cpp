#include "tools/gap/report/injection.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <stdexcept>

#include "sim_hal/plant.hpp"
#include "tools/cli/in_parallel.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/gap/logs/experiment.hpp"
#include "tools/gap/report/robot_files.hpp"

namespace wheelwright::gap {
namespace {

using tools::MeasuredLog;
using tools::MeasuredSample;

constexpr double kDriver_s = 1;

// The simulated robot, one sample of a log after the other.
class Stepper {
  public:
    Stepper(const SimulatedRobot& robot, const model::EffectSet<double>& effects, const MeasuredLog& log)
        : turning_(robot.turning), period_s_(log.period_s), plant_(parameters_of(robot, effects, log)) {
        plant_.place({0, 0, log.start_heading_rad}, {});
    }
    // From these wheel speeds, under this torque, over a sample. What tyres slip goes on.
    WheelPair<double> step(const WheelPair<double>& speed, const WheelPair<double>& torque_Nm) {
        const WheelPair<double> slip = plant_.slip_m_per_s();
        const WheelPair<double>& radius_m = plant_.actual().geometry.wheel_radius_m;
        WheelPair<double> rolls = balanced(speed);
        rolls.left -= slip.left / radius_m.left;
        rolls.right -= slip.right / radius_m.right;
        plant_.place(plant_.pose(), twist_of(rolls), slip);
        const int steps = static_cast<int>(std::ceil(period_s_ / kFineStep_s - 1e-9));
        for (int n = 0; n < steps; ++n) plant_.advance(period_s_ / steps, balanced(torque_Nm));
        return plant_.wheel_speed_rad_per_s();
    }
    Twist<double> twist_of(const WheelPair<double>& speed) const {
        return model::twist_from_wheel_speeds(plant_.actual().geometry, speed);
    }

  private:
    static sim::PlantParameters parameters_of(const SimulatedRobot& robot,
                                              const model::EffectSet<double>& effects,
                                              const MeasuredLog& log) {
        sim::PlantParameters p = sim::plant_from_dynamics(robot.geometry, robot.dynamics, effects);
        p.span_s = log.samples.back().t_s - log.samples.front().t_s;
        return p;
    }
    WheelPair<double> balanced(const WheelPair<double>& pair) const {
        const double mean = pair.sum() / 2;
        return turning_ ? pair : WheelPair<double>{mean, mean};
    }

    bool turning_;
    double period_s_;
    sim::Plant plant_;
};

// What brings the robot back to a log's speeds.
WheelPair<double> drivers_torque_Nm(const SimulatedRobot& robot, const Twist<double>& behind) {
    const double mean = robot.driving ? behind.v_m_per_s / (2 * robot.dynamics.k7_per_kg_m * kDriver_s) : 0.0;
    const double half =
        robot.turning ? behind.omega_rad_per_s / (2 * robot.dynamics.k8_per_kg_m2 * kDriver_s) : 0.0;
    return {mean - half, mean + half};
}

// As the drives tell it.
void report_late(const model::EffectSet<double>& effects, MeasuredLog& log) {
    if (!effects.active[kMeasurementLag]) return;
    const auto report = [&](double WheelPair<double>::*side) {
        model::MeasurementLag::Memory<double> late{log.samples.front().speed_rad_per_s.*side};
        for (MeasuredSample& s : log.samples) {
            double& speed = s.speed_rad_per_s.*side;
            speed = model::MeasurementLag::report_speed(effects.parameter[kMeasurementLag], late, speed,
                                                        log.period_s);
        }
    };
    report(&WheelPair<double>::left);
    report(&WheelPair<double>::right);
}

void write_csv(const MeasuredLog& log, const std::string& path) {
    std::FILE* file = std::fopen(path.c_str(), "w");
    if (file == nullptr) throw std::runtime_error(path + " cannot be written");
    std::fprintf(file, "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s%s\n",
                 log.has_gyro ? ",gyro_z_rad_s" : "");
    for (const MeasuredSample& s : log.samples) {
        std::fprintf(file, "%.9f,%.10g,%.10g,%.10g,%.10g", s.t_s, s.torque_Nm.left, s.torque_Nm.right,
                     s.speed_rad_per_s.left, s.speed_rad_per_s.right);
        if (log.has_gyro) std::fprintf(file, ",%.10g", s.gyro_rad_per_s);
        std::fputc('\n', file);
    }
    std::fclose(file);
}

struct Task {
    const Detectable* of = nullptr;
    double factor = 0;
    std::size_t repeat = 0;
};

bool has(const std::vector<NamedEffect>& effects, std::size_t effect) {
    return std::any_of(effects.begin(), effects.end(), [&](const auto& e) { return e.effect == effect; });
}

void count(const Findings& found, const std::vector<NamedEffect>& at_first, Detection& sum) {
    ++sum.logs;
    if (has(found.effects, sum.effect)) {
        ++sum.named;
        return;
    }
    const auto stands_beside = [&](const NamedEffect& e) {
        return std::any_of(e.rivals.begin(), e.rivals.end(),
                           [&](const Rival& r) { return r.effect == sum.effect; });
    };
    const auto is_new = [&](const NamedEffect& e) { return !has(at_first, e.effect); };
    if (std::any_of(found.effects.begin(), found.effects.end(),
                    [&](const NamedEffect& e) { return is_new(e) && stands_beside(e); })) {
        ++sum.confounded;
    } else if (std::any_of(found.effects.begin(), found.effects.end(), is_new)) {
        ++sum.elsewhere;
        for (const NamedEffect& e : found.effects) {
            if (is_new(e)) sum.instead.insert(e.effect);
        }
    }
}

}  // namespace

MeasuredLog inject(const MeasuredLog& log, const SimulatedRobot& found,
                   const model::EffectSet<double>& with_effect, std::size_t shift) {
    const std::size_t steps = log.samples.size() - 1;
    std::vector<WheelPair<double>> missed(steps);
    Stepper bare(found, found.effects, log);
    for (std::size_t i = 0; i < steps; ++i) {
        const MeasuredSample& s = log.samples[i];
        const WheelPair<double> simulated = bare.step(s.speed_rad_per_s, s.torque_Nm);
        const WheelPair<double>& measured = log.samples[i + 1].speed_rad_per_s;
        missed[i] = {measured.left - simulated.left, measured.right - simulated.right};
    }
    MeasuredLog made = log;
    Stepper robot(found, with_effect, log);
    for (std::size_t i = 0; i < steps; ++i) {
        MeasuredSample& s = made.samples[i];
        const Twist<double> wanted = bare.twist_of(log.samples[i].speed_rad_per_s);
        const Twist<double> is = bare.twist_of(s.speed_rad_per_s);
        const WheelPair<double> help = drivers_torque_Nm(
            found, {wanted.v_m_per_s - is.v_m_per_s, wanted.omega_rad_per_s - is.omega_rad_per_s});
        s.torque_Nm.left += help.left;
        s.torque_Nm.right += help.right;
        const WheelPair<double> next = robot.step(s.speed_rad_per_s, s.torque_Nm);
        const WheelPair<double>& noise = missed[(i + shift) % steps];
        MeasuredSample& after = made.samples[i + 1];
        after.gyro_rad_per_s -= bare.twist_of(after.speed_rad_per_s).omega_rad_per_s;
        after.speed_rad_per_s = {next.left + noise.left, next.right + noise.right};
        after.gyro_rad_per_s += robot.twist_of(after.speed_rad_per_s).omega_rad_per_s;
    }
    report_late(with_effect, made);
    return made;
}

std::vector<Detection> verify_detection(const Request& request, const Findings& findings,
                                        const DetectionOptions& options) {
    const ReadBack back = read_back(findings.extended_file, "robot.extended.toml");
    if (!back.robot) throw std::runtime_error(back.problem);
    const Logs logs = read_logs(request.logs, request.robot, request.reading);

    std::vector<Detection> sums;
    std::vector<Task> tasks;
    for (const Detectable& d : findings.search.detectable) {
        const auto asked = [&](const std::string& name) { return name == model::kEffects[d.effect].name; };
        if (!options.only.empty() && std::none_of(options.only.begin(), options.only.end(), asked)) continue;
        if (back.robot->effects.active[d.effect] || !d.parameters || d.parameters(1).empty()) continue;
        for (const double factor : options.factors) {
            sums.push_back({d.effect, factor});
            for (std::size_t r = 0; r < options.repeats; ++r) tasks.push_back({&d, factor, r});
        }
    }

    const tools::ScratchFolder scratch;
    std::mutex mutex;
    tools::in_parallel(tasks.size(), options.jobs, options.progress, [&](std::size_t t) {
        const Task& task = tasks[t];
        // one coordinate after the other
        const std::vector<model::Parameters<double>> all = task.of->parameters(task.factor);
        model::EffectSet<double> effects = back.robot->effects;
        effects.active[task.of->effect] = true;
        effects.parameter[task.of->effect] = all[task.repeat % all.size()];
        Request again = request;
        again.reading = {};
        again.reading.wheel_radius_m = request.reading.wheel_radius_m;
        again.heldout_log.clear();
        again.progress = [](const std::string&) {};
        again.logs.clear();
        const std::string name = scratch.path() + "/" + std::to_string(t) + "_";
        for (std::size_t i = 0; i < logs.logs.size(); ++i) {
            const MeasuredLog& log = logs.logs[i];
            const std::size_t shift = log.samples.size() * (task.repeat + 1) / (options.repeats + 1);
            again.logs.push_back(name + std::to_string(i) + ".csv");
            write_csv(inject(log, *back.robot, effects, shift), again.logs.back());
        }
        const Findings found = analyse(again);
        for (const std::string& path : again.logs) std::filesystem::remove(path);
        const std::scoped_lock lock(mutex);
        for (Detection& sum : sums) {
            if (sum.effect != task.of->effect || sum.factor != task.factor) continue;
            count(found, findings.effects, sum);
        }
        return std::string(model::kEffects[task.of->effect].name);
    });
    return sums;
}

}  // namespace wheelwright::gap
