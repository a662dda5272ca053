#include "tools/gap_bench/splits.hpp"

#include <algorithm>
#include <cmath>

#include "firmware/task/robot_file.hpp"
#include "tools/cli/in_parallel.hpp"
#include "tools/cli/report.hpp"
#include "tools/gap_bench/peers/peers.hpp"

namespace wheelwright::bench {
namespace {

constexpr double kOneRate = 0.02;  // by which steps of one robot's runs may differ

// Everything that a split needs; the pieces point into the corpus.
struct Task {
    Split split;
    model::Geometry<double> geometry;
    std::vector<Piece> training, held_out;
    GapQuestion question;
};

std::vector<Piece> pieces_of(const CorpusRun& run) {
    std::vector<Piece> pieces;
    for (const tools::MeasuredLog& log : run.segments) pieces.push_back({&log, 0, log.samples.size()});
    return pieces;
}

std::vector<peers::ForwardRun> forward_runs(const std::vector<Piece>& pieces) {
    std::vector<peers::ForwardRun> runs;
    for (const Piece& piece : pieces) {
        const auto size = static_cast<Eigen::Index>(piece.end - piece.first);
        peers::ForwardRun run{Eigen::VectorXd(size), Eigen::VectorXd(size)};
        for (Eigen::Index i = 0; i < size; ++i) {
            const tools::MeasuredSample& s = piece.log->samples[piece.first + static_cast<std::size_t>(i)];
            run.speed_rad_per_s(i) = s.speed_rad_per_s.sum() / 2;
            run.torque_Nm(i) = s.torque_Nm.sum() / 2;
        }
        runs.push_back(std::move(run));
    }
    return runs;
}

void compare(Task& task) {
    const std::vector<peers::ForwardRun> training = forward_runs(task.training);
    const std::vector<peers::ForwardRun> held_out = forward_runs(task.held_out);
    double power = 0;
    double samples = 0;
    for (const peers::ForwardRun& run : held_out) {
        power += run.speed_rad_per_s.squaredNorm();
        samples += static_cast<double>(run.speed_rad_per_s.size());
    }
    const double steps = samples - static_cast<double>(held_out.size());
    const auto rms = [&](const peers::OneStepLaw& law) {
        double sum = 0;
        for (const peers::ForwardRun& run : held_out) sum += peers::squared_error(law, run);
        return std::sqrt(sum / steps);
    };
    Split& split = task.split;
    split.signal_rad_per_s = std::sqrt(power / samples);
    split.torque_alone_rad_per_s = rms(peers::torque_alone(training));
    split.sysid_rad_per_s = rms(peers::sysid_regression(training, task.geometry.mean_radius_m()));
    split.plain_rad_per_s = rms(peers::plain_least_squares(training));
    split.gap = ask_gap(task.question, task.held_out);
}

std::vector<Split> compare_all(std::vector<Task> tasks, std::size_t jobs, const Progress& progress) {
    tools::in_parallel(tasks.size(), jobs, progress, [&](std::size_t i) {
        if (tasks[i].split.unusable.empty()) compare(tasks[i]);
        return tasks[i].split.robot + " " + tasks[i].split.held_out;
    });
    std::vector<Split> splits;
    for (Task& task : tasks) splits.push_back(std::move(task.split));
    return splits;
}

GapQuestion question_of(const BenchOptions& options, const model::Geometry<double>& geometry,
                        const std::string& robot, const std::string& split) {
    GapQuestion question;
    question.program = options.program;
    question.reading = options.reading;
    question.geometry = geometry;
    question.out = options.out + "/" + robot + "/" + split;
    return question;
}

Task leave_out(const CorpusRobot& robot, const CorpusRun& held_out, const BenchOptions& options) {
    Task task;
    task.split.robot = robot.name;
    task.split.held_out = held_out.name;
    task.split.unusable = held_out.unusable;
    task.split.published = held_out.published;
    task.geometry = robot.geometry;
    task.held_out = pieces_of(held_out);
    task.question = question_of(options, robot.geometry, robot.name, held_out.name);
    task.question.held_out = {"--heldout", held_out.path};
    if (robot.torque_per_volt_Nm) {
        task.question.reading.emplace_back("--torque-per-volt");
        task.question.reading.push_back(task::shortest_number(*robot.torque_per_volt_Nm));
    }
    for (const CorpusRun& run : robot.runs) {
        if (&run == &held_out || !run.forward) continue;
        const std::vector<Piece> pieces = pieces_of(run);
        task.training.insert(task.training.end(), pieces.begin(), pieces.end());
        task.question.logs.push_back(run.path);
    }
    if (task.split.unusable.empty() && task.training.empty())
        task.split.unusable = "no other run of " + robot.name + " can be learned from";
    for (const Piece& piece : task.training) {
        const double period_s = task.split.unusable.empty() ? task.held_out.front().log->period_s : 0;
        if (period_s > 0 && std::abs(piece.log->period_s - period_s) > kOneRate * period_s) {
            task.split.unusable = "runs are sampled every " + tools::number_text(period_s) + " and every " +
                                  tools::number_text(piece.log->period_s) +
                                  " s; one step to the next is one law at one rate only";
        }
    }
    return task;
}

}  // namespace

std::vector<Split> leave_one_run_out(const Corpus& corpus, const BenchOptions& options,
                                     const Progress& progress) {
    std::vector<Task> tasks;
    for (const CorpusRobot& robot : corpus.robots) {
        for (const CorpusRun& run : robot.runs) {
            if (run.forward || !run.unusable.empty()) tasks.push_back(leave_out(robot, run, options));
        }
    }
    return compare_all(std::move(tasks), options.jobs, progress);
}

std::vector<Split> split_one_log(const CorpusRun& run, const model::Geometry<double>& geometry,
                                 const std::vector<double>& percents, const BenchOptions& options,
                                 const Progress& progress) {
    std::size_t samples = 0;
    for (const tools::MeasuredLog& log : run.segments) samples += log.samples.size();
    std::vector<Task> tasks;
    for (const double percent : percents) {
        Task task;
        task.split.robot = run.name;
        task.split.held_out = tools::number_text(percent) + " %";
        task.geometry = geometry;
        task.question = question_of(options, geometry, run.name, tools::number_text(percent));
        task.question.logs = {run.path};
        auto before = static_cast<std::size_t>(percent / 100 * static_cast<double>(samples));
        for (const tools::MeasuredLog& log : run.segments) {
            const std::size_t cut = std::min(before, log.samples.size());
            before -= cut;
            if (cut > 1) task.training.push_back({&log, 0, cut});
            if (log.samples.size() - cut < 2) continue;
            if (task.held_out.empty())
                task.question.held_out = {"--heldout-from", task::shortest_number(log.samples[cut].t_s)};
            task.held_out.push_back({&log, cut, log.samples.size()});
        }
        tasks.push_back(std::move(task));
    }
    return compare_all(std::move(tasks), options.jobs, progress);
}

}  // namespace wheelwright::bench
