#include "tools/gap_trials/campaign.hpp"

#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>

#include "firmware/task/write_file.hpp"
#include "tools/cli/run_program.hpp"
#include "tools/gap_trials/further.hpp"
#include "tools/gap_trials/hidden/ode_plant.hpp"
#include "tools/gap_trials/hidden/oracle.hpp"
#include "tools/gap_trials/own_plant.hpp"

namespace wheelwright::tools {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

std::string number(double value) {
    std::array<char, 40> text{};
    std::snprintf(text.data(), text.size(), "%.9g", value);
    return text.data();
}

std::optional<std::string> contents(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) return std::nullopt;
    return std::string(std::istreambuf_iterator<char>(file), {});
}

void write(const fs::path& path, std::string_view text) {
    const std::string failed = task::write_whole_file(path.string(), text);
    if (!failed.empty()) throw std::runtime_error(failed);
}

// A log is large and may be lost: no need to wait for the disk.
void write_log(const fs::path& path, const std::string& text) {
    std::ofstream file(path, std::ios::binary);
    file << text;
    file.close();
    if (!file) throw std::runtime_error("cannot write " + path.string());
}

// `words`: the command, with the logs, without what is told of the robot.
Finding analyse(const hidden::Trial& trial, std::vector<std::string> words, const fs::path& out,
                double time_limit_s) {
    fs::remove_all(out);  // what an interrupted run left
    fs::create_directories(out);
    for (const std::string& word :
         {std::string("--wheel-radius"), number(trial.robot.wheel_radius_m), std::string("--track"),
          number(trial.robot.track_m), std::string("--out"), out.string()}) {
        words.push_back(word);
    }
    const Ended ended = run_program(words, (out / "output.txt").string(), time_limit_s);
    Finding finding;
    finding.verdict = "no_answer";
    const std::string abnormal = ended.abnormal(time_limit_s);
    const auto json = ended.problem.empty() && !ended.too_long ? contents(out / "gap.json") : std::nullopt;
    if (json) {
        finding = read_gap_json(*json);
    } else if (!abnormal.empty()) {
        finding.problem = abnormal;
    } else {
        finding.problem = "no gap.json; exit status " + std::to_string(WEXITSTATUS(ended.status));
    }
    finding.seconds = ended.seconds;
    finding.memory_bytes = ended.memory_bytes;
    return finding;
}

fs::path result_of(const fs::path& out, const hidden::ListedTrial& trial) {
    return out / "results" / (trial.plan.id + ".json");
}

// `further`: one without further analyses is none.
std::optional<Outcome> stored(const fs::path& out, const hidden::ListedTrial& trial, bool further) {
    const auto json = contents(result_of(out, trial));
    if (!json) return std::nullopt;
    try {
        Outcome outcome = outcome_from_json(*json);
        if (further && !outcome.asked_further) return std::nullopt;
        return outcome;
    } catch (const std::exception&) {
        return std::nullopt;  // cut short: run again
    }
}

}  // namespace

std::set<std::string> every_nth(const std::vector<hidden::ListedTrial>& trials, std::size_t n) {
    std::set<std::string> names;
    std::map<hidden::Kind, std::size_t> count;
    for (const hidden::ListedTrial& trial : trials) {
        if (n > 0 && count[trial.plan.kind]++ % n == 0) names.insert(trial.plan.id);
    }
    return names;
}

bool can_analyse(const std::string& analyser) { return ends_well({analyser, "gap", "--help"}); }

bool ends_well(const std::vector<std::string>& words) { return run_program(words, "/dev/null", 60).well(); }

Outcome run_trial(const hidden::ListedTrial& listed, const CampaignOptions& options) {
    for (const char* folder : {"logs", "labels", "results", "analyses"})
        fs::create_directories(options.out / folder);
    const hidden::PlantMaker make_plant = listed.plant == "own" ? make_own_plant : hidden::make_ode_plant;
    const hidden::Trial trial = hidden::generate(listed.plan, listed.plant, make_plant);
    const hidden::OracleVerdict oracle = hidden::ask_oracle(trial);
    const std::string label = hidden::label_text(trial, oracle);
    const std::string& id = listed.plan.id;
    const fs::path log = options.out / "logs" / (id + ".csv");
    const fs::path sealed = options.out / "labels" / (id + ".json");
    // of an earlier run: not to be read by the analysis, nor taken for this one's
    fs::remove(sealed);
    fs::remove(result_of(options.out, listed));
    write_log(log, hidden::csv_text(trial));
    const fs::path analyses = options.out / "analyses";
    const Finding finding =
        analyse(trial, {options.analyser, "gap", log.string()}, analyses / id, options.time_limit_s);
    std::map<std::string, Finding> beside;
    for (std::size_t i = 0; i < options.beside.size(); ++i) {
        const Comparison& other = options.beside[i];
        std::vector<std::string> words = other.command;
        words.push_back(log.string());
        beside[other.name] =
            analyse(trial, std::move(words), analyses / (id + ".beside-" + std::to_string(i + 1)),
                    options.time_limit_s);
    }
    std::vector<fs::path> written{log};
    std::map<std::string, Further> further;
    const bool asks_all = options.further.contains(id);
    if (!options.further.empty()) {
        const auto write_beside = [&](const std::string& ending, const std::string& text) {
            written.push_back(options.out / "logs" / (id + "." + ending));
            write_log(written.back(), text);
            return written.back();
        };
        const auto ask = [&](const std::string& name, const std::vector<fs::path>& logs,
                             const std::vector<std::string>& more) {
            std::vector<std::string> words{options.analyser, "gap"};
            for (const fs::path& path : logs) words.push_back(path.string());
            words.insert(words.end(), more.begin(), more.end());
            return analyse(trial, std::move(words), analyses / (id + "." + name), options.time_limit_s);
        };
        further = ask_further({trial, oracle, make_plant, finding, log, analyses / id, write_beside, ask},
                              asks_all);
    }
    write(sealed, label);
    if (!options.keep_logs) {
        for (const fs::path& path : written) fs::remove(path);
    }
    Outcome outcome = judge(read_label(label), finding);
    outcome.beside = std::move(beside);
    outcome.asked_further = asks_all;
    outcome.further = std::move(further);
    write(result_of(options.out, listed), outcome_json(outcome));
    return outcome;
}

std::vector<Outcome> run_trials(const std::vector<hidden::ListedTrial>& trials,
                                const CampaignOptions& options,
                                const std::function<void(const CampaignProgress&)>& progress,
                                const std::function<bool()>& stop) {
    std::vector<std::optional<Outcome>> outcomes(trials.size());
    std::atomic<std::size_t> next{0};
    std::atomic<bool> failed{false};
    std::mutex mutex;
    std::exception_ptr error;
    CampaignProgress state;
    state.all = trials.size();
    const auto begin = Clock::now();
    const auto work = [&] {
        for (std::size_t i = next++; i < trials.size() && !failed && !stop(); i = next++) {
            try {
                std::optional<Outcome> outcome;
                if (options.resume)
                    outcome = stored(options.out, trials[i], options.further.contains(trials[i].plan.id));
                if (!outcome) outcome = run_trial(trials[i], options);
                const std::scoped_lock lock(mutex);
                ++state.done;
                state.elapsed_s = seconds_since(begin);
                state.last = trials[i].plan.id + " " + outcome->said;
                if (!outcome->finding.problem.empty()) state.last += " (" + outcome->finding.problem + ")";
                outcomes[i] = std::move(outcome);
                progress(state);
            } catch (const hidden::CannotDraw& cannot) {
                const std::scoped_lock lock(mutex);
                ++state.done;
                state.elapsed_s = seconds_since(begin);
                state.last = cannot.what();
                progress(state);
            } catch (...) {
                const std::scoped_lock lock(mutex);
                if (!error) error = std::current_exception();
                failed = true;
            }
        }
    };
    std::vector<std::thread> threads;
    for (std::size_t i = 1; i < std::min(options.jobs, trials.size()); ++i) threads.emplace_back(work);
    work();
    for (std::thread& thread : threads) thread.join();
    if (error) std::rethrow_exception(error);
    std::vector<Outcome> done;
    for (auto& outcome : outcomes) {
        if (outcome) done.push_back(std::move(*outcome));
    }
    return done;
}

std::vector<Outcome> stored_outcomes(const std::vector<hidden::ListedTrial>& trials, const fs::path& out,
                                     const std::set<std::string>& further) {
    std::vector<Outcome> outcomes;
    for (const hidden::ListedTrial& trial : trials) {
        if (auto outcome = stored(out, trial, further.contains(trial.plan.id)))
            outcomes.push_back(std::move(*outcome));
    }
    return outcomes;
}

}  // namespace wheelwright::tools
