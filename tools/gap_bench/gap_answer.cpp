#include "tools/gap_bench/gap_answer.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "firmware/task/robot_file.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/gap/model/free_run.hpp"

namespace wheelwright::bench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

std::string joined(const std::vector<std::string>& names) {
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
    return all;
}

std::vector<std::string> command_of(const GapQuestion& q) {
    std::vector<std::string> words{q.program, "gap"};
    words.insert(words.end(), q.logs.begin(), q.logs.end());
    words.insert(words.end(), q.held_out.begin(), q.held_out.end());
    words.insert(words.end(), q.reading.begin(), q.reading.end());
    const auto number = [](double value) { return task::shortest_number(value); };
    for (const std::string& word : {std::string("--wheel-radius"), number(q.geometry.wheel_radius_m.left),
                                    number(q.geometry.wheel_radius_m.right), std::string("--track"),
                                    number(q.geometry.track_m), std::string("--out"), q.out}) {
        words.push_back(word);
    }
    return words;
}

void take_parameter(const std::string& effect, const std::string& name, const Json& said, GapAnswer& answer) {
    const Json& interval = said.at("interval_95");
    if (!interval.is_array() || !interval.at(0).is_number() || !interval.at(1).is_number()) return;
    answer.parameters.push_back({effect, name, said.at("value").get<double>(), interval.at(0).get<double>(),
                                 interval.at(1).get<double>()});
}

// Throws Json::exception where it is not what docs/gap.md says.
void take_json(const Json& json, GapAnswer& answer) {
    answer.verdict = json.at("verdict").get<std::string>();
    if (const auto problems = json.find("problems"); problems != json.end()) {
        answer.refusal = joined(problems->get<std::vector<std::string>>());
        return;
    }
    for (const Json& effect : json.at("effects")) {
        NamedEffect named{effect.at("name").get<std::string>(), {}};
        for (const Json& rival : effect.at("rivals"))
            named.rivals.push_back(rival.at("name").get<std::string>());
        for (const Json& parameter : effect.at("parameters"))
            take_parameter(named.name, parameter.at("name").get<std::string>(), parameter, answer);
        answer.effects.push_back(std::move(named));
    }
    for (const auto& [name, known] : json.at("parameter_shift").items())
        take_parameter("", name, known, answer);
    for (const Json& tried : json.value("tried", Json::array())) {
        answer.tried.push_back({tried.at("name").get<std::string>(), tried.at("unknowns").get<double>(),
                                tried.at("beside_friction").get<double>(),
                                tried.at("beside_found").get<double>()});
    }
    answer.denied = json.value("denied", answer.denied);
    const Json stated = json.value("/heldout/forward_rms_rad_s/after"_json_pointer, Json());
    if (stated.is_number()) answer.stated_rms_rad_per_s = stated.get<double>();
}

std::optional<gap::SimulatedRobot> written_robot(const std::string& path, std::string& refusal) {
    const task::RobotFileResult read = task::read_robot_file(path);
    if (!read.robot) {
        refusal = "no model: " + (read.problems.empty() ? path : task::to_text(read.problems.front()));
        return std::nullopt;
    }
    const std::optional<gap::SimulatedRobot> robot = gap::simulated_robot(*read.robot);
    if (!robot || !robot->driving) refusal = "no model: K7 is not known";
    return refusal.empty() ? robot : std::nullopt;
}

// Of both wheels' mean, and over both wheels.
void run_freely(const gap::SimulatedRobot& robot, const std::vector<Piece>& pieces, GapAnswer& answer) {
    double forward = 0;
    double both = 0;
    double count = 0;
    for (const Piece& piece : pieces) {
        const auto& samples = piece.log->samples;
        both +=
            gap::free_run(robot, {piece.log, piece.first, piece.end, 0}, samples[piece.first].speed_rad_per_s,
                          [&](std::size_t i, const WheelPair<double>& simulated) {
                              const double off = simulated.sum() - samples[i].speed_rad_per_s.sum();
                              forward += off * off / 4;
                              count += 1;
                          });
    }
    answer.rms_rad_per_s = std::sqrt(forward / count);
    answer.both_wheels_rms_rad_per_s = std::sqrt(both / 2 / count);
}

}  // namespace

Held GapAnswer::held(std::string_view effect) const {
    Held held = Held::missing;
    for (const NamedEffect& named : effects) {
        if (named.name == effect) return Held::named;
        if (std::find(named.rivals.begin(), named.rivals.end(), effect) != named.rivals.end())
            held = Held::confounded;
    }
    return held;
}

bool GapAnswer::both_frictions() const {
    return std::all_of(kFrictions.begin(), kFrictions.end(),
                       [&](std::string_view friction) { return held(friction) != Held::missing; });
}

std::vector<NamedEffect> GapAnswer::others() const {
    std::vector<NamedEffect> others;
    for (const NamedEffect& named : effects) {
        if (std::find(kFrictions.begin(), kFrictions.end(), named.name) == kFrictions.end())
            others.push_back(named);
    }
    return others;
}

std::string GapAnswer::names() const {
    std::vector<std::string> names;
    for (const NamedEffect& named : effects)
        names.push_back(named.name + (named.rivals.empty() ? "" : " (" + joined(named.rivals) + ")"));
    return joined(names);
}

GapAnswer ask_gap(const GapQuestion& question, const std::vector<Piece>& held_out) {
    fs::remove_all(question.out);
    fs::create_directories(question.out);
    if (!fs::is_directory(question.out)) throw std::runtime_error(question.out + " is no folder");
    const std::string output = question.out + "/output.txt";
    const tools::Ended ended = tools::run_program(command_of(question), output, question.time_limit_s);
    GapAnswer answer;
    answer.refusal = ended.abnormal(question.time_limit_s);
    if (!answer.refusal.empty()) return answer;
    std::ifstream json(question.out + "/gap.json");
    if (!json) {
        std::ifstream said(output);
        std::getline(said, answer.refusal);
        answer.refusal = "no gap.json: " + answer.refusal;
        return answer;
    }
    try {
        take_json(Json::parse(json), answer);
    } catch (const Json::exception& error) {
        answer.refusal = std::string("gap.json: ") + error.what();
    }
    if (!answer.refusal.empty()) return answer;
    if (const auto robot = written_robot(question.out + "/robot.extended.toml", answer.refusal))
        run_freely(*robot, held_out, answer);
    return answer;
}

}  // namespace wheelwright::bench
