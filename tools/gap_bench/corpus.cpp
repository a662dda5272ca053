#include "tools/gap_bench/corpus.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "tools/ident/drive_samples.hpp"

namespace wheelwright::bench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

double positive(const Json& robot, const char* key) {
    const auto found = robot.find(key);
    if (found == robot.end() || !found->is_number() || !(found->get<double>() > 0)) {
        throw std::runtime_error(std::string(key) + " is " +
                                 (found == robot.end() ? "missing" : found->dump()) +
                                 ", expected a number greater than 0");
    }
    return found->get<double>();
}

Published published(const Json& robot, const std::string& run) {
    const Json figures = robot.value("heldout_rms_rad_s", Json::object());
    const auto of_run = figures.find(run);
    if (of_run == figures.end()) return {};
    const auto figure = [&](const char* key) -> std::optional<double> {
        const auto found = of_run->find(key);
        if (found == of_run->end() || !found->is_number()) return std::nullopt;
        return found->get<double>();
    };
    return {figure("signal"), figure("torque_only"), figure("sysid_regression")};
}

bool goes_forward(const std::vector<tools::MeasuredLog>& segments) {
    double forward = 0;
    double turning = 0;
    for (const tools::MeasuredLog& log : segments) {
        for (const tools::MeasuredSample& s : log.samples) {
            forward += std::pow(s.speed_rad_per_s.right + s.speed_rad_per_s.left, 2);
            turning += std::pow(s.speed_rad_per_s.right - s.speed_rad_per_s.left, 2);
        }
    }
    return forward > turning;
}

CorpusRobot read_robot(const fs::path& folder, const std::string& name, const Json& entry,
                       tools::LogReading reading) {
    CorpusRobot robot;
    robot.name = name;
    const double radius_m = positive(entry, "wheel_radius_m");
    robot.geometry = {{radius_m, radius_m}, positive(entry, "track_m")};
    reading.wheel_radius_m = robot.geometry.wheel_radius_m;
    const bool stated = reading.torque_per_volt_Nm.has_value();
    if (!stated && entry.contains("Nm_per_V")) reading.torque_per_volt_Nm = positive(entry, "Nm_per_V");
    if (!fs::is_directory(folder)) throw std::runtime_error(folder.string() + " is no folder");
    for (const fs::directory_entry& file : fs::directory_iterator(folder)) {
        const bool sysid = file.path().extension() == ".json";
        if (file.path().extension() != ".csv" && !sysid) continue;
        if (sysid && !stated) robot.torque_per_volt_Nm = reading.torque_per_volt_Nm;
        for (CorpusRun& run : read_runs(file.path().string(), reading)) {
            run.published = published(entry, run.name);
            robot.runs.push_back(std::move(run));
        }
    }
    std::sort(robot.runs.begin(), robot.runs.end(),
              [](const CorpusRun& a, const CorpusRun& b) { return a.name < b.name; });
    if (robot.runs.size() < 2) {
        throw std::runtime_error(
            folder.string() + " holds " + std::to_string(robot.runs.size()) +
            " runs (*.csv, *.json), expected at least 2: one to hold out, one to learn from");
    }
    return robot;
}

}  // namespace

std::vector<CorpusRun> read_runs(const std::string& path, const tools::LogReading& reading) {
    tools::SampledLog log = tools::read_sampled_log(path, std::nullopt, reading);
    std::vector<CorpusRun> runs;
    const auto begin = [&](const std::string& name) {
        CorpusRun run;
        run.name = name.empty() ? fs::path(path).stem().string() : name;
        run.path = name.empty() ? path : path + ":" + name;
        runs.push_back(std::move(run));
    };
    if (!log.problems.empty()) {
        begin("");
        runs.back().unusable = log.problems.front();
        return runs;
    }
    for (tools::MeasuredLog& segment : log.logs) {
        if (runs.empty() || (!segment.run.empty() && runs.back().name != segment.run)) begin(segment.run);
        runs.back().segments.push_back(std::move(segment));
    }
    for (CorpusRun& run : runs) run.forward = goes_forward(run.segments);
    return runs;
}

Corpus read_corpus(const std::string& folder, const std::vector<std::string>& only,
                   const tools::LogReading& reading) {
    Corpus corpus;
    const std::string list = (fs::path(folder) / "robots.json").string();
    std::ifstream file(list);
    if (!file) {
        corpus.problems.push_back(list + ": cannot be opened; expected one entry for each robot's folder");
        return corpus;
    }
    Json robots;
    try {
        robots = Json::parse(file);
    } catch (const Json::exception& error) {
        corpus.problems.push_back(list + ": is not JSON: " + error.what());
        return corpus;
    }
    if (!robots.is_object()) {
        corpus.problems.push_back(list + ": expected an object of robots by name");
        return corpus;
    }
    for (const std::string& name : only) {
        if (!robots.contains(name)) corpus.problems.push_back(list + ": has no robot " + name);
    }
    for (const auto& [name, entry] : robots.items()) {
        if (!only.empty() && std::find(only.begin(), only.end(), name) == only.end()) continue;
        try {
            corpus.robots.push_back(read_robot(fs::path(folder) / name, name, entry, reading));
        } catch (const std::exception& error) {
            corpus.problems.push_back(list + ": " + name + ": " + error.what());
        }
    }
    if (corpus.problems.empty() && corpus.robots.empty()) corpus.problems.push_back(list + ": has no robots");
    return corpus;
}

}  // namespace wheelwright::bench
