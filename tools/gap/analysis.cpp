#include "tools/gap/analysis.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "tools/cli/report.hpp"
#include "tools/gap/hypotheses/hypotheses.hpp"
#include "tools/gap/inference/evaluations.hpp"
#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/misfit.hpp"
#include "tools/gap/inference/outcome.hpp"
#include "tools/gap/inference/residual.hpp"
#include "tools/gap/inference/rivals.hpp"
#include "tools/gap/inference/robots.hpp"
#include "tools/gap/inference/sensor_evidence.hpp"
#include "tools/gap/inference/slip.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/logs/experiment.hpp"
#include "tools/gap/report/robot_files.hpp"

namespace wheelwright::gap {
namespace {

constexpr int kBroadPasses = 1;  // evaluations closer by with everything in the catalogue

std::vector<std::string> files_of(const Request& request) {
    std::vector<std::string> paths = request.logs;
    if (!request.heldout_log.empty()) paths.push_back(request.heldout_log);
    return paths;
}

// What was not looked for, as was asked; "": nothing.
std::string words_of_excluded(const Request& request) {
    std::string names;
    for (const std::size_t effect : request.without)
        names += (names.empty() ? "" : ", ") + std::string(model::kEffects[effect].name);
    return names.empty() ? "" : "not looked for, as was asked: " + names;
}

EvaluationOptions evaluation_options(const Request& request, const Overview& overview, Parts parts,
                                     Known known) {
    EvaluationOptions options;
    options.geometry = request.geometry;
    if (request.robot) options.base = request.robot->effects;
    options.overview = overview;
    options.parts = std::move(parts);
    options.known = std::move(known);
    return options;
}

ResidualOptions residual_options(const Evaluations& evaluations, std::span<const LogPart> training,
                                 const Known& known) {
    const Evaluation& last = evaluations.last();
    ResidualOptions options;
    options.setting = evaluations.setting_found();
    options.found = effects_of(last.search.members, last.search.after, last.dictionary.setting());
    options.known = known;
    options.training = training;
    options.blocks = evaluations.block_options();
    options.turning = evaluations.turning();
    return options;
}

std::vector<int> shapes_of_friction(const Evaluation& evaluation) {
    return evaluation.dictionary.rich_columns_of("low wheel speed");
}

// With intervals as wide as other estimates of the same differ, that of `weak` among them: the fit before it
// was refined.
Search with_misfit(const Search& search, const Fit& weak, const Evaluation& last) {
    Search result = search;
    std::vector<Amount> frictions;
    for (const Candidate& candidate : search.friction) {
        if (!contains(search.members, candidate.effect))
            frictions.insert(frictions.end(), candidate.amounts.begin(), candidate.amounts.end());
    }
    const Eigen::VectorXd refined_by = search.after.value - weak.value;
    Eigen::MatrixXd& covariance = result.after.covariance;
    covariance += misfit_covariance(last.train, last.colour, weak, shapes_of_friction(last), frictions) +
                  refined_by * refined_by.transpose();
    for (const Eigen::VectorXd& moved : search.moved_by_rivals) covariance += moved * moved.transpose() / 2;
    result.effects = described_anew(result, last.dictionary.setting());
    return result;
}

// What few pieces tell has an error as much larger as Student's t has it. `spread`: the error that the pieces
// tell.
Search with_few_pieces(const Search& search, const Eigen::MatrixXd& spread, const Setting& setting) {
    Search result = search;
    Eigen::VectorXd few = search.after.telling;
    for (double& telling : few)
        telling = std::max(1.0, interval_quantile(telling + 3) / interval_quantile(double(search.blocks)));
    result.after.covariance += few.asDiagonal() * spread * few.asDiagonal();
    result.after.covariance -= spread;
    result.effects = described_anew(result, setting);
    return result;
}

// An effect that was found and is not to be named, and why.
struct Denied {
    std::size_t effect = 0;
    std::string why;
};
// An effect of which nothing that the log tells is told from zero, with all that makes it unsure.
std::optional<Denied> not_told_from_zero(const Search& search, const Setting& setting) {
    for (std::size_t i = search.base_members; i < search.members.size(); ++i) {
        const std::size_t effect = search.members[i].effect;
        if (!search.may_be_denied(effect) || hypothesis_of(effect).dry) continue;
        bool known = false, told = false;
        for (const ParameterEstimate& p :
             parameters_in(search.members, i, search.after, setting, search.blocks)) {
            known = known || p.known;
            told = told || (p.known && (p.interval_95[0] > 0 || p.interval_95[1] < 0));
        }
        if (known && !told) return Denied{effect, "how much of it there is is not told from nothing"};
    }
    return std::nullopt;
}

std::optional<Denied> denied_by(const Evaluations& evaluations, std::span<const LogPart> training) {
    const Evaluation& last = evaluations.last();
    const Setting& setting = last.dictionary.setting();
    const FreeRunsSay say =
        by_free_runs(last.search, pointers(last.train), training, setting, evaluations.turning());
    if (say.no_better)
        return Denied{*say.no_better, "the simulated robot drives no closer to the logs with it"};
    if (const auto effect = unsure_by_misfit(last.search, setting, last.train, last.colour,
                                             shapes_of_friction(last), say.unsure))
        return Denied{*effect, "how much of it there is depends on how the rows are weighed"};
    if (found_slip(last.search) &&
        !slip_in_rows(last.search, residual_options(evaluations, training, evaluations.known())).surely)
        return Denied{kSlip, "beside what comes late by another law, and other free shapes, it is not sure"};
    return std::nullopt;
}

std::optional<Denied> evaluate_all(Evaluations& evaluations, std::span<const LogPart> training) {
    evaluations.evaluate();
    evaluations.evaluate_closer(kBroadPasses);
    return denied_by(evaluations, training);
}

// The robot found, for motions that would tell what it was named for from something else. `setting`, here and
// below: of the last evaluation's dictionary.
Confusion confusion(const Search& s, const Setting& setting, double torque_rms_Nm, const Overview& overview,
                    bool turning) {
    Confusion c;
    c.setting = setting;
    c.setting.dynamics = whole_dynamics(s.after, s.unknowable, turning, setting.geometry.track_m);
    c.points = s.points;
    c.effects = effects_of(s.members, s.after, setting);
    c.members = s.members;
    c.torque_rms_Nm = torque_rms_Nm;
    c.speed_rms_rad_per_s = overview.speed_rms_rad_per_s;
    c.noise_rad_per_s = overview.noise_rad_per_s;
    return c;
}

void take_robots(Findings& findings, const Setting& setting, bool turning) {
    const Search& s = findings.search;
    const auto errors_of = [](const Fit& fit) {
        return model::Dynamics<double>{fit.error(0), fit.error(1), fit.error(2), fit.error(3)};
    };
    const SimulatedRobot before = robot_of(base_members(s), s.base, setting, turning);
    const SimulatedRobot after = robot_of(s.members, s.after, setting, turning);
    findings.before = before.dynamics;
    findings.after = after.dynamics;
    findings.before_error = errors_of(s.base);
    findings.after_error = errors_of(s.after);
    findings.effects_before = before.effects;
    findings.effects_after = after.effects;
}

// As the files say, read back.
std::optional<Models> written_models(Findings& findings, const Request& request) {
    make_files(findings, request);
    if (!findings.file_problem.empty()) return std::nullopt;
    const ReadBack before = read_back(findings.before_file, "robot.before.toml");
    const ReadBack after = read_back(findings.extended_file, "robot.extended.toml");
    if (!before.robot || !after.robot) {
        findings.notes.push_back("no free run: " + (before.robot ? after.problem : before.problem));
        return std::nullopt;
    }
    Models models{{}, *before.robot, *after.robot};
    if (request.robot) {
        models.nominal = request.robot_text.empty()
                             ? SimulatedRobot{{}, request.robot->dynamics, request.robot->effects}
                             : read_back(request.robot_text, "the given robot file").robot;
        if (models.nominal) models.nominal->geometry = request.geometry;
    }
    return models;
}

// Mean squared whitened residual of the given model.
double gap_of(const model::RobotParameters& given, const Search& search, const BlockSet& train) {
    const Blocks all = pointers(train);
    const Fit nominal = nominal_fit(search, given);
    return squares(all, nominal) / row_count(all, nominal.shape);
}

void judge_held_out(Findings& findings, const LogPart& part, const Models& models) {
    findings.heldout_s = part.log->period_s * double(part.end - part.first - 1);
    findings.heldout_rms_rad_per_s = speed_rms_rad_per_s(part);
    findings.heldout = free_runs(part, models);
    if (!std::isfinite(findings.heldout.back().after.both))
        findings.notes.emplace_back(
            "the robot found runs away from the held-out part, and by how much is no figure");
    findings.trace = trace_of(part, models);
}

}  // namespace

Findings analyse(const Request& request) {
    const double track_m = request.geometry.track_m;
    Findings findings;

    // the logs, before any model
    if (!request.without.empty()) findings.notes.push_back(words_of_excluded(request));
    const Logs logs = read_logs(files_of(request), request.robot, request.reading);
    findings.notes.insert(findings.notes.end(), logs.notes.begin(), logs.notes.end());
    findings.faults = logs.faults;
    findings.problems = logs.problems;
    if (!findings.problems.empty()) return findings;
    const Overview overview = overview_of(logs.logs, request.geometry);
    findings.duration_s = overview.duration_s;
    findings.rate_Hz = 1 / overview.period_s;
    findings.noise_rad_per_s = overview.noise_rad_per_s;
    findings.turning = overview.turning;
    findings.problems = overview.problems;
    if (!findings.problems.empty()) return findings;

    // the sensors by themselves
    Sensors sensors = sensors_of(logs.logs, request.geometry, overview.turning, request.without);
    findings.gyro = sensors.gyro;
    if (sensors.unknown_step_rad_per_s > 0) {
        findings.notes.push_back(
            "the speeds are told in steps of " + tools::number_text(sensors.unknown_step_rad_per_s, 3) +
            " rad/s, by a sensor that is slower than the log: over how long it counts, and "
            "so how many counts a turn has, is not known");
    }
    if (sensors.gyro) {
        const std::optional<std::string> wrong = wrong_beside_gyro(*sensors.gyro);
        if (wrong) findings.problems.push_back(*wrong);
    }
    if (!findings.problems.empty()) return findings;

    const Parts parts = split(logs, request.geometry, {!request.heldout_log.empty(), request.heldout_from_s});
    const auto& last_log = logs.logs.back();
    findings.heldout_from_s = parts.held_out ? parts.held_out->log->samples[parts.held_out->first].t_s
                                             : last_log.samples.back().t_s;

    // the evaluations
    request.progress("products of columns");
    Evaluations evaluations(
        evaluation_options(request, overview, parts, known_before(sensors, request.without, track_m)));
    if (const std::optional<std::string> problem = evaluations.first_model()) {
        findings.problems.push_back(*problem);
        return findings;
    }
    const bool turning = evaluations.turning();
    if (!turning) sensors.gyro.reset();  // no radii show in a robot that its torques do not turn
    request.progress("search");
    while (true) {
        std::optional<Denied> denied = evaluate_all(evaluations, parts.training);
        if (!denied) {
            const Evaluation& last = evaluations.last();
            const Setting& setting = last.dictionary.setting();
            const Search found =
                refined(last.search, parts.training, setting, turning, overview.speed_rms_rad_per_s);
            const Search unsure = with_misfit(found, last.search.after, last);
            denied = not_told_from_zero(unsure, setting);
            findings.search = with_few_pieces(unsure, found.after.covariance, setting);
        }
        if (!denied) break;
        evaluations.deny(denied->effect);
        findings.notes.push_back(std::string(model::kEffects[denied->effect].name) +
                                 ": not looked for, because " + denied->why);
    }
    const Known& known = evaluations.known();
    findings.denied = known.rivals_only;
    findings.turning = turning;
    findings.blocks = evaluations.blocks();

    // what they leave, and what else is to be said of what they found
    const Evaluation& last = evaluations.last();
    const Setting& setting = last.dictionary.setting();
    const Search& found = last.search;
    findings.closable_share = closed_share(pointers(evaluations.held_out()), found);
    const ResidualOptions options = residual_options(evaluations, parts.training, known);
    const Residual residual = residual_of(found, options);
    findings.where = residual.where;
    std::optional<SlipFound> slip;
    if (turning && may_slip(found, known))
        slip = slip_of(slip_by_gyro(logs.logs, request.geometry), slip_in_rows(found, options), setting);
    const Search& search = findings.search;
    std::vector<std::size_t> known_effects = known.excluded;
    for (const auto& given : known.given) known_effects.push_back(given.first);
    std::vector<NamedEffect> effects =
        with_motions(with_unmeasured_rivals(search.effects, known_effects, known.most_report_lag_s),
                     confusion(search, setting, last.train.torque_rms_Nm, overview, turning));
    if (slip) {
        effects.push_back(named_slip(*slip, setting));
        findings.notes.emplace_back(
            "wheel_slip is a rolling tyre's: it grows with the speed, "
            "as the robot file's does not, and is not written there");
    }
    const BesideSensors beside = beside_sensors(std::move(effects), sensors, known, request.without, track_m);
    findings.effects = beside.effects;
    SensorGrounds grounds{slip.has_value(), beside.shown, {}};
    for (const BesideSensors::Denied& denied : beside.denied) {
        std::erase_if(findings.where, [&](const Place& p) { return p.name == denied.place; });
        findings.where.insert(findings.where.begin() + std::ptrdiff_t(grounds.denied.size()),
                              {denied.place, 1.0});
        grounds.denied.push_back(denied.what);
    }
    findings.conclusion = conclude(residual.conclusion, grounds);
    if (beside.shown && !slip && residual.conclusion.verdict == Verdict::nothing_missing)
        findings.closable_share = std::numeric_limits<double>::quiet_NaN();  // it moves no wheel

    // the models beside the logs
    take_robots(findings, setting, turning);
    const std::optional<Models> models = written_models(findings, request);
    if (request.robot) findings.gap_nominal = gap_of(*request.robot, search, last.train);
    request.progress("free run on the held-out part");
    const WheelPair<double>& noise = overview.noise_rad_per_s;
    findings.floor_rad_per_s = std::sqrt((noise.left * noise.left + noise.right * noise.right) / 2);
    if (parts.held_out && models) judge_held_out(findings, *parts.held_out, *models);
    if (models && models->after.driving) findings.against_speed = torque_missing(logs.logs, *models);

    std::erase_if(findings.search.detectable, [&](const Detectable& d) {
        return std::find(request.without.begin(), request.without.end(), d.effect) != request.without.end();
    });
    return findings;
}

}  // namespace wheelwright::gap
