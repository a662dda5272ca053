#include "tools/gap/report/output.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "tools/cli/report.hpp"
#include "tools/excite/motions.hpp"
#include "tools/gap/inference/statistics.hpp"
#include "tools/gap/report/robot_files.hpp"

namespace wheelwright::gap {
namespace {

using Json = nlohmann::ordered_json;
using tools::number_text;

std::string words_of(const Rival& rival) {
    if (!rival.measurement.empty()) return std::string(rival.measurement);
    return rival.motion != nullptr ? std::string(rival.motion->words) : "another motion";
}

// A free run that has no figure has run away (held_out.hpp).
std::string error_text(double error_rad_per_s) {
    return std::isfinite(error_rad_per_s) ? number_text(error_rad_per_s, 3) : "runs away";
}

}  // namespace

std::string name_of(std::size_t effect) { return std::string(model::kEffects[effect].name); }

std::string joined(std::span<const std::string> names) {
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
    return all;
}

std::string words(const Findings& f) {
    const Search& s = f.search;
    std::string text;
    const auto line = [&](const std::string& l) { text += l + "\n"; };
    for (const std::string& note : f.notes) line("Note: " + note);
    line(std::string("Verdict: ") + verdict_name(f.conclusion.verdict) + ": " + f.conclusion.reason + ".");
    for (const NamedEffect& e : f.effects) {
        const model::EffectInfo& info = model::kEffects[e.effect];
        line("");
        line(std::string(info.name) + ": " + std::string(info.meaning));
        line("  closes " + number_text(100 * e.closes, 3) + " % of the closable gap; its torque is " +
             number_text(100 * e.torque_share, 3) + " % of the torque");
        for (std::size_t j = 0; j < e.parameters.size(); ++j) {
            const ParameterEstimate& p = e.parameters[j];
            line("  " + std::string(info.parameters[j].name) + " = " + number_text(p.value, 4) + " +- " +
                 number_text(p.standard_error, 2) + " (95 %: " + number_text(p.interval_95[0], 4) + " .. " +
                 number_text(p.interval_95[1], 4) + ")");
        }
        for (const Rival& r : e.rivals) {
            line("  rival: " + name_of(r.effect) +
                 (r.confounded ? ", the same in every motion of this log" : ", not ruled out") +
                 "; told apart by: " + words_of(r));
        }
    }
    if (!f.where.empty()) {
        line("");
        line("Where simulation and measurement part (share of the closable gap that depends on it):");
        for (const Place& p : f.where) line("  " + p.name + ": " + number_text(100 * p.explains, 3) + " %");
    }
    if (!s.unknowable.empty()) line("This log cannot show: " + joined(s.unknowable));
    if (!f.heldout.empty()) {
        line("");
        line("Free run on " + number_text(f.heldout_s, 3) + " s held out, wheel speed error in rad/s RMS:");
        for (const FreeRun& r : f.heldout) {
            line("  " + (r.window_s > 0 ? number_text(r.window_s, 3) + " s" : std::string("all")) + ": " +
                 (r.nominal ? "given model " + error_text(r.nominal->both) + ", " : std::string()) +
                 "before " + error_text(r.before.both) + ", after " + error_text(r.after.both) + ", noise " +
                 number_text(f.floor_rad_per_s, 3) +
                 (f.turning ? std::string()
                            : "; forward, without the wheels' difference, of which nothing is said: before " +
                                  error_text(r.before.forward) + ", after " + error_text(r.after.forward)));
        }
    }
    if (f.closed_loop) {
        const ClosedLoop& loop = *f.closed_loop;
        line("");
        line("Figure-8 of " + loop.plant + ", with an exact external pose, error from 12 s on:");
        const auto one = [&](const char* name, const FigureEight& drive) {
            line(std::string("  ") + name + ": " +
                 (drive.driven ? number_text(1e3 * drive.rms_m, 3) + " mm RMS, " +
                                     number_text(1e3 * drive.peak_m, 3) + " mm at worst"
                               : "not driven" + (drive.stopped.empty() ? "" : ", fault " + drive.stopped)));
        };
        if (loop.nominal) one("given model", *loop.nominal);
        one("before, K5..K8 fitted anew", loop.before);
        one("after, with what was found", loop.after);
        if (loop.truth) one("with the truth itself", *loop.truth);
    }
    return text;
}

// What is not finite becomes null there.
std::string json(const Findings& f, const Request& request) {
    const Search& s = f.search;
    Json out;
    out["format"] = "wheelwright gap 1";
    if (!f.problems.empty()) {
        out["verdict"] = verdict_name(Verdict::unusable_log);
        out["problems"] = f.problems;
        out["effects"] = Json::array();
        return out.dump(2) + "\n";
    }
    out["verdict"] = verdict_name(f.conclusion.verdict);
    out["reason"] = f.conclusion.reason;
    out["effects"] = Json::array();
    Json advice = Json::array();
    for (const NamedEffect& e : f.effects) {
        const model::EffectInfo& info = model::kEffects[e.effect];
        Json effect;
        effect["name"] = info.name;
        effect["parameters"] = Json::array();
        for (std::size_t j = 0; j < e.parameters.size(); ++j) {
            const ParameterEstimate& p = e.parameters[j];
            effect["parameters"].push_back({{"name", info.parameters[j].name},
                                            {"value", p.value},
                                            {"standard_error", p.standard_error},
                                            {"interval_95", {p.interval_95[0], p.interval_95[1]}},
                                            {"unit", info.parameters[j].unit}});
        }
        effect["closes"] = e.closes;
        effect["torque_share"] = e.torque_share;
        effect["probability"] = e.probability;
        effect["rivals"] = Json::array();
        for (const Rival& r : e.rivals) {
            effect["rivals"].push_back({{"name", name_of(r.effect)},
                                        {"same_in_this_log", r.confounded},
                                        {"keeps", r.keeps},
                                        {"separated_by", words_of(r)}});
            Json one{{"tell", info.name}, {"from", name_of(r.effect)}, {"motion", words_of(r)}};
            if (r.motion != nullptr) {
                one["name"] = r.motion->name;
                one["torque_Nm"] = r.motion_size_Nm;
                one["duration_s"] = excite::kMotion_s;
            }
            advice.push_back(one);
        }
        effect["ruled_out"] = Json::array();
        for (const Rival& r : e.ruled_out) {
            effect["ruled_out"].push_back({{"name", name_of(r.effect)}, {"keeps", r.keeps}});
        }
        out["effects"].push_back(effect);
    }
    Json shift = Json::object();
    const double quantile = interval_quantile(double(s.blocks));
    for (const KFigure& k : known_k(f.after, f.after_error, s.unknowable)) {
        Json one{{"value", k.value},
                 {"standard_error", k.error},
                 {"interval_95", {k.value - quantile * k.error, k.value + quantile * k.error}},
                 {"unit", k.unit}};
        if (request.robot) {
            const model::ParameterInfo* info = model::find_parameter("dynamics." + std::string(k.key));
            const double given = info->get(*request.robot);
            one["given"] = given;
            one["shift"] = k.value - given;
        }
        shift[k.key] = one;
    }
    out["parameter_shift"] = shift;
    out["unknowable"] = s.unknowable;
    out["without"] = Json::array();
    for (const std::size_t effect : request.without) out["without"].push_back(name_of(effect));
    out["where"] = Json::array();
    for (const Place& p : f.where) out["where"].push_back({{"place", p.name}, {"explains", p.explains}});
    out["detectable"] = Json::object();
    for (const Detectable& d : s.detectable) {
        const model::EffectInfo& info = model::kEffects[d.effect];
        Json one = Json::object();
        for (std::size_t j = 0; j < std::min(d.size.size(), info.parameters.size()); ++j) {
            one[std::string(info.parameters[j].name)] = d.size[j];
        }
        out["detectable"][std::string(info.name)] = one;
    }
    out["tried"] = Json::array();
    for (const Tried& t : s.tried) {
        out["tried"].push_back({{"name", name_of(t.effect)},
                                {"unknowns", t.unknowns},
                                {"beside_friction", t.beside_friction},
                                {"beside_found", t.beside_found}});
    }
    out["denied"] = Json::array();
    for (const std::size_t effect : f.denied) out["denied"].push_back(name_of(effect));
    out["advice"] = advice;
    Json gap;
    gap["nominal"] = f.gap_nominal ? Json(*f.gap_nominal) : Json(nullptr);
    gap["refit"] = s.gap_refit;
    gap["after"] = s.gap_after;
    gap["floor"] = s.floor;
    gap["closable_torque_share"] = s.closable_torque_share;
    gap["left_torque_share"] = s.residual_torque_share;
    Json heldout;
    heldout["from_s"] = f.heldout_from_s;
    heldout["duration_s"] = f.heldout_s;
    heldout["signal_rms_rad_s"] = f.heldout_rms_rad_per_s;
    heldout["windows"] = Json::array();
    for (const FreeRun& r : f.heldout) {
        const auto errors = [&](double SpeedError::*of, double floor_rad_per_s) {
            return Json{{"nominal", r.nominal ? Json(*r.nominal.*of) : Json(nullptr)},
                        {"before", r.before.*of},
                        {"after", r.after.*of},
                        {"floor", floor_rad_per_s}};
        };
        Json one = errors(&SpeedError::both, f.floor_rad_per_s);
        // the mean of two sensors is noisy by the root of a half of one
        const Json forward = errors(&SpeedError::forward, f.floor_rad_per_s / std::numbers::sqrt2);
        if (r.window_s == 0) {
            heldout["wheel_speed_rms_rad_s"] = one;
            heldout["forward_rms_rad_s"] = forward;
        } else {
            one["forward"] = forward;
            one["window_s"] = r.window_s;
            one["windows"] = r.windows;
            heldout["windows"].push_back(one);
        }
    }
    gap["heldout"] = heldout;
    out["gap"] = gap;
    out["heldout"] = heldout;
    out["closable_share"] = f.closable_share;
    if (f.closed_loop) {
        const auto one = [](const FigureEight& drive) {
            Json figures{{"driven", drive.driven}};
            if (!drive.stopped.empty()) figures["fault"] = drive.stopped;
            if (drive.driven) {
                figures["rms_m"] = drive.rms_m;
                figures["peak_m"] = drive.peak_m;
            }
            return figures;
        };
        const ClosedLoop& loop = *f.closed_loop;
        out["closed_loop"] = {{"plant", loop.plant},
                              {"truth_known", loop.truth_known},
                              {"figure_eight",
                               {{"nominal", loop.nominal ? one(*loop.nominal) : Json(nullptr)},
                                {"before", one(loop.before)},
                                {"after", one(loop.after)},
                                {"truth", loop.truth ? one(*loop.truth) : Json(nullptr)}}}};
    }
    Json log;
    log["files"] = request.logs;
    log["notes"] = f.notes;
    log["faults"] = Json::array();
    for (const LogFault& fault : f.faults) {
        log["faults"].push_back({{"name", fault.name},
                                 {"samples", fault.count},
                                 {"share", fault.rate},
                                 {"first_s", fault.first_s}});
    }
    log["duration_s"] = f.duration_s;
    log["rate_Hz"] = f.rate_Hz;
    log["blocks"] = f.blocks;
    log["turning_used"] = f.turning;
    log["wheel_speed_noise_rad_s"] = {f.noise_rad_per_s.left, f.noise_rad_per_s.right};
    log["torque_acts_late_samples"] = {s.timing_samples, s.timing_error};
    if (f.gyro) {
        log["gyro"] = {{"bias_rad_per_s", f.gyro->bias_rad_per_s},
                       {"per_wheel_yaw_rate", f.gyro->slope},
                       {"standard_error", f.gyro->slope_error},
                       {"wheels_lag_s", f.gyro->lag_s}};
    }
    out["log"] = log;
    return out.dump(2) + "\n";
}

}  // namespace wheelwright::gap
