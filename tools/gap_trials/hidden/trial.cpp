#include "tools/gap_trials/hidden/trial.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>
#include <system_error>

#include "tools/gap_trials/hidden/electronics.hpp"
#include "tools/gap_trials/hidden/random.hpp"

namespace wheelwright::hidden {
namespace {

constexpr double kStep_s = 5e-4;  // of the plant
constexpr int kMostRuns = 8;
constexpr std::uint64_t kMostDraws = 3;
constexpr std::uint64_t kAnotherNoise = std::uint64_t{1} << 56U;  // added to the seed

// The part of a run that the sizes are told from.
struct Run {
    std::vector<Sample> samples;
    std::vector<double> effect_rms_Nm;  // of each effect
    double slipped_share = 0;
    double rms_torque_Nm = 0;
    double peak_torque_Nm = 0;
    double rms_speed_rad_per_s = 0;
    double peak_speed_rad_per_s = 0;
    double rms_drag_m2_per_s2 = 0;  // of v |v|
    long complaints = 0;
};

double rounded(double value, double step) { return step > 0 ? step * std::round(value / step) : value; }

// Sets a parameter of every effect by its one adjustable number, and says how large the effect then is.
class Sizing {
  public:
    Sizing(const EffectInfo& info, const std::array<double, 2>& range, const Trial& trial, const Run& without,
           Random& random)
        : info_(info),
          range_(range),
          target_(random.uniform(range[0] * 0.9 + range[1] * 0.1, range[0] * 0.1 + range[1] * 0.9)) {
        draw(trial, without, random);
    }

    HiddenEffect effect() const {
        HiddenEffect effect = shape_;
        for (const char* name : scaled_) effect.parameters[name] *= scale_;
        return effect;
    }

    double reached(const Run& run, std::size_t index) const {
        switch (info_.kind) {
            case SizeKind::share:
                return run.effect_rms_Nm[index] / run.rms_torque_Nm;
            case SizeKind::travel_share:
                return run.slipped_share;
            case SizeKind::peak_share:
                return effect()[scaled_.front()] / run.peak_torque_Nm;
            case SizeKind::value:
                break;
        }
        return target_;
    }

    bool fits(double size) const { return size >= range_[0] && size <= range_[1]; }

    // The next number to try: a secant in logarithms.
    void improve(double size) {
        const double wanted = std::log(target_ / std::max(size, target_ * 1e-3));
        double slope = info_.name == "back_emf_limit" ? -3 : 1;
        if (last_size_ > 0 && scale_ != last_scale_ && size > 0 && size != last_size_) {
            slope = std::log(size / last_size_) / std::log(scale_ / last_scale_);
            const double sign = info_.name == "back_emf_limit" ? -1 : 1;
            slope = sign * std::clamp(sign * slope, 0.4, 12.0);
        }
        last_size_ = size;
        last_scale_ = scale_;
        scale_ *= std::exp(std::clamp(wanted / slope, -1.5, 1.5));
    }

  private:
    void draw(const Trial& trial, const Run& without, Random& random) {
        const double torque = target_ * without.rms_torque_Nm;
        const auto two_sided = [&](const char* left, const char* right, double value) {
            // equal in every other robot
            const double uneven = random.chance(0.5) ? 1 : random.uniform(0.7, 1.4);
            const double mean = std::sqrt((1 + uneven * uneven) / 2);
            shape_.parameters = {{left, value / mean}, {right, value * uneven / mean}};
            scaled_ = {left, right};
        };
        shape_.name = info_.name;
        auto& p = shape_.parameters;
        const std::string_view name = info_.name;
        if (name == "viscous_friction") {
            two_sided("left_Nm_s_per_rad", "right_Nm_s_per_rad", torque / without.rms_speed_rad_per_s);
        } else if (name == "coulomb_friction") {
            two_sided("left_Nm", "right_Nm", torque);
        } else if (name == "stribeck_friction") {
            p = {{"coulomb_Nm", torque},
                 {"static_Nm", torque * random.uniform(1.5, 2.3)},
                 {"stribeck_rad_per_s", random.uniform(0.6, 2.0)}};
            scaled_ = {"coulomb_Nm", "static_Nm"};
        } else if (name == "quadratic_drag") {
            p = {
                {"drag_N_s2_per_m2", torque / (without.rms_drag_m2_per_s2 * trial.robot.wheel_radius_m / 2)}};
            scaled_ = {"drag_N_s2_per_m2"};
        } else if (name == "turning_scrub") {
            p = {{"scrub_Nm", torque * trial.robot.track_m / trial.robot.wheel_radius_m}};
            scaled_ = {"scrub_Nm"};
        } else if (name == "castor_drag") {
            const double rolling = torque / trial.robot.wheel_radius_m;
            p = {{"rolling_N", rolling},
                 {"swivel_Nm", rolling * random.uniform(0.005, 0.015)},
                 {"arm_m", trial.robot.castor_ahead_m},
                 {"trail_m", random.uniform(0.02, 0.04)}};
            scaled_ = {"rolling_N", "swivel_Nm"};
        } else if (name == "slope") {
            p = {{"angle_rad", target_}, {"uphill_rad", random.uniform(-std::numbers::pi, std::numbers::pi)}};
        } else if (name == "torque_bias") {
            const double direction = random.uniform(0, 2 * std::numbers::pi);
            p = {{"left_Nm", torque * std::numbers::sqrt2 * std::cos(direction)},
                 {"right_Nm", torque * std::numbers::sqrt2 * std::sin(direction)}};
            scaled_ = {"left_Nm", "right_Nm"};
        } else if (name == "torque_gain_mismatch" || name == "wheel_radius_mismatch") {
            p = {{"relative", target_ * random.sign()}};
        } else if (name == "cog_lateral") {
            p = {{"offset_m", target_ * random.sign()}};
        } else if (name == "actuator_lag" || name == "measurement_lag") {
            p = {{"time_constant_s", target_}};
        } else if (name == "transport_delay") {
            p = {{"delay_s", target_}};
        } else if (name == "dead_zone") {
            p = {{"width_Nm", target_ * without.peak_torque_Nm}};
            scaled_ = {"width_Nm"};
        } else if (name == "backlash") {
            p = {{"half_gap_rad", target_},
                 {"motor_inertia_kg_m2", trial.robot.wheel_inertia_kg_m2 * random.uniform(0.4, 0.7)}};
        } else if (name == "torque_saturation") {
            p = {{"limit_Nm", target_ * without.peak_torque_Nm}};
            scaled_ = {"limit_Nm"};
        } else if (name == "back_emf_limit") {
            p = {{"stall_Nm", without.peak_torque_Nm},
                 {"no_load_rad_per_s", without.peak_speed_rad_per_s * random.uniform(1.3, 1.8)}};
            scaled_ = {"stall_Nm"};
        } else if (name == "wheel_slip") {
            // enough for the largest torque of the log, so that the wheels slip but do not spin
            const Robot& r = trial.robot;
            const double load_N = r.mass_kg * 9.81 * (1 - r.cog_ahead_m / r.castor_ahead_m) / 2;
            const double needed = without.peak_torque_Nm / r.wheel_radius_m / load_N;
            p = {{"friction_coefficient", needed * random.uniform(1.2, 1.7)},
                 {"slip_speed_m_per_s", target_ * 2}};
            scaled_ = {"slip_speed_m_per_s"};
        } else if (name == "payload_step") {
            p = {{"time_s", trial.duration_s * random.uniform(0.3, 0.7)},
                 {"mass_kg", target_ * trial.robot.mass_kg},
                 {"inertia_kg_m2", target_ * trial.robot.yaw_inertia_kg_m2 * random.uniform(0.7, 1.3)}};
        } else if (name == "gain_drift") {
            p = {{"loss", target_},
                 {"time_constant_s", random.chance(0.5) ? 0 : trial.duration_s * random.uniform(0.15, 0.4)}};
        } else if (name == "torque_ripple") {
            p = {{"amplitude_Nm", torque * std::numbers::sqrt2},
                 {"order", static_cast<double>(2 + random.below(11))},
                 {"phase_rad", random.uniform(-std::numbers::pi, std::numbers::pi)}};
            scaled_ = {"amplitude_Nm"};
        } else if (name == "encoder_quantisation") {
            p = {{"counts_per_turn", target_}};
        } else if (name == "gyro_bias") {
            p = {{"bias_rad_per_s", target_ * random.sign()}};
        } else if (name == "log_outliers" || name == "log_dropouts") {
            p = {{"rate", target_}};
        } else {
            throw std::logic_error("no parameters for " + shape_.name);
        }
    }

    const EffectInfo& info_;
    std::array<double, 2> range_;
    double target_;
    HiddenEffect shape_;
    std::vector<const char*> scaled_;  // the parameters that grow with the size
    double scale_ = 1;
    double last_size_ = 0;
    double last_scale_ = 1;
};

// `programme`: what is driven instead of the trial's motions, with a noise of its own.
Run drive(const Trial& trial, const HiddenSet& hidden, const PlantMaker& make_plant,
          const TorqueProgramme* programme = nullptr) {
    const Noise& noise = kNoises[trial.plan.noise];
    // The same driver and the same noise in every run of a trial.
    Random driver_random(trial.plan.seed, trial.plan.stream * 4 + 1);
    Random noise_random(trial.plan.seed + (programme != nullptr ? kAnotherNoise : 0),
                        trial.plan.stream * 4 + 2);
    Driver driver(trial.robot, trial.motions, trial.duration_s, trial.quick, driver_random);
    const std::unique_ptr<Plant> plant = make_plant(trial.robot, hidden);
    TorquePath path(hidden, trial.duration_s);
    SpeedReport report(hidden);
    double counts = kUsualCountsPerTurn;
    if (const HiddenEffect* quantised = hidden.find("encoder_quantisation"))
        counts = (*quantised)["counts_per_turn"];
    double gyro_bias = 0;
    if (const HiddenEffect* bias = hidden.find("gyro_bias")) gyro_bias = (*bias)["bias_rad_per_s"];
    const double step = speed_step_rad_per_s(counts);

    Run run;
    const auto per_sample = static_cast<std::size_t>(std::lround(1 / (trial.rate_Hz * kStep_s)));
    const double duration_s = programme != nullptr ? programme->duration_s() : trial.duration_s;
    const auto samples = static_cast<std::size_t>(std::lround(duration_s * trial.rate_Hz)) + 1;
    run.samples.reserve(samples);
    double torque_squares = 0;
    double speed_squares = 0;
    double drag_squares = 0;
    PlantState now = plant->state();
    for (std::size_t k = 0; k < samples; ++k) {
        Sample s;
        s.t_s = static_cast<double>(k) / trial.rate_Hz;
        s.truth = now;
        s.clean_rad_per_s = report.reported(s.truth.wheel_speed_rad_per_s);
        s.clean_gyro_rad_per_s = s.truth.yaw_rate_rad_per_s + gyro_bias;
        const auto measured = [&](double value) {
            return rounded(value + noise.speed_rad_per_s * noise_random.gaussian(), step);
        };
        s.speed_rad_per_s.left = measured(s.clean_rad_per_s.left);
        s.speed_rad_per_s.right = measured(s.clean_rad_per_s.right);
        s.gyro_rad_per_s = s.clean_gyro_rad_per_s + noise.gyro_rad_per_s * noise_random.gaussian();
        s.torque_Nm = programme != nullptr ? driver.command(*programme, s.t_s, s.speed_rad_per_s)
                                           : driver.command(s.t_s, s.speed_rad_per_s);
        path.command(s.t_s, s.torque_Nm);
        for (const double torque : {s.torque_Nm.left, s.torque_Nm.right}) {
            torque_squares += torque * torque;
            run.peak_torque_Nm = std::max(run.peak_torque_Nm, std::abs(torque));
        }
        for (const double speed : {s.truth.wheel_speed_rad_per_s.left, s.truth.wheel_speed_rad_per_s.right}) {
            speed_squares += speed * speed;
            run.peak_speed_rad_per_s = std::max(run.peak_speed_rad_per_s, std::abs(speed));
        }
        drag_squares += std::pow(s.truth.speed_m_per_s, 4);
        run.samples.push_back(s);
        if (k + 1 == samples) break;
        for (std::size_t i = 0; i < per_sample; ++i) {
            const double t_s = s.t_s + static_cast<double>(i) * kStep_s;
            plant->advance(kStep_s, path.shaft_torque_Nm(t_s, kStep_s, now));
            now = plant->state();
            report.advance(kStep_s, now.wheel_speed_rad_per_s);
        }
    }
    const double n = 2 * static_cast<double>(samples);
    run.rms_torque_Nm = std::sqrt(torque_squares / n);
    run.rms_speed_rad_per_s = std::sqrt(speed_squares / n);
    run.rms_drag_m2_per_s2 = std::sqrt(drag_squares / (n / 2));
    run.complaints = plant->complaints();
    run.slipped_share = plant->slipped_m() / std::max(plant->travelled_m(), 1e-6);
    for (const HiddenEffect& effect : hidden.effects) {
        run.effect_rms_Nm.push_back(
            std::max(path.effect_rms_Nm(effect.name), plant->effect_rms_Nm(effect.name)));
    }
    return run;
}

// What goes wrong on the way into the file. The first second stays whole.
void damage(Trial& trial, Random& random) {
    const auto first = static_cast<std::size_t>(trial.rate_Hz);
    const double size = 5 * trial.robot.torque_limit_Nm;  // some times the usual speeds
    if (const HiddenEffect* outliers = trial.hidden.find("log_outliers")) {
        for (std::size_t k = first; k < trial.samples.size(); ++k) {
            Sample& s = trial.samples[k];
            for (double* speed : {&s.speed_rad_per_s.left, &s.speed_rad_per_s.right}) {
                if (random.chance((*outliers)["rate"])) *speed += random.sign() * size * random.uniform(1, 4);
            }
        }
    }
    if (const HiddenEffect* dropouts = trial.hidden.find("log_dropouts")) {
        for (std::size_t k = first; k < trial.samples.size(); ++k) {
            const std::size_t held = 3 + random.below(18);
            if (!random.chance((*dropouts)["rate"] / static_cast<double>(held))) continue;
            const Sample& last = trial.samples[k - 1];
            for (std::size_t i = k; i < std::min(k + held, trial.samples.size()); ++i) {
                trial.samples[i].speed_rad_per_s = last.speed_rad_per_s;
                trial.samples[i].gyro_rad_per_s = last.gyro_rad_per_s;
            }
            k += held;
        }
    }
}

}  // namespace

std::string_view name_of(Kind kind) {
    constexpr std::array<std::string_view, 5> kNames{"single", "pair", "nothing", "fault", "blind"};
    return kNames[static_cast<std::size_t>(kind)];
}

namespace {

void take(Run run, Trial& trial) {
    trial.samples = std::move(run.samples);
    trial.rms_torque_Nm = run.rms_torque_Nm;
    trial.complaints = run.complaints;
    trial.peak_torque_Nm = run.peak_torque_Nm;
}

Trial drawn(const TrialPlan& plan, std::string_view plant_name, const PlantMaker& make_plant,
            std::uint64_t draw) {
    Trial trial;
    trial.plan = plan;
    trial.plant = plant_name;
    Random random(plan.seed + (draw << 40U), plan.stream * 4);
    trial.robot = draw_robot(random);
    const std::size_t count = 2 + random.below(3);
    // No motion twice; the first ones of a log tell more than straight and spin, which come along in some.
    std::vector<Motion> left(kMotions.begin(), kMotions.end());
    for (std::size_t i = 0; i < count; ++i) {
        const auto chosen = static_cast<std::ptrdiff_t>(random.below(left.size()));
        trial.motions.push_back(left[static_cast<std::size_t>(chosen)]);
        left.erase(left.begin() + chosen);
    }
    constexpr std::array<double, 3> kDurations_s{30, 45, 60};
    constexpr std::array<double, 5> kRates_Hz{100, 200, 250, 500, 1000};
    trial.duration_s = kDurations_s[random.below(kDurations_s.size())];
    trial.rate_Hz = kRates_Hz[random.below(kRates_Hz.size())];
    trial.gyro = random.chance(0.5);
    std::vector<const EffectInfo*> infos;
    for (const std::string& name : plan.effects) {
        infos.push_back(find_effect(name));
        if (infos.back() == nullptr) throw std::runtime_error("unknown effect " + name);
        if (infos.back()->needs_gyro || infos.back()->gyro_tells) trial.gyro = true;
        if (infos.back()->quick) {
            std::erase(trial.motions, Motion::prbs);
            std::erase(trial.motions, Motion::chirp);
            trial.motions.resize(std::min<std::size_t>(trial.motions.size(), 1));
            trial.motions.insert(trial.motions.begin(), {Motion::prbs, Motion::chirp});
            trial.duration_s = kDurations_s.back();
            trial.quick = true;
        }
    }
    if (!plan.motions.empty()) trial.motions = plan.motions;
    if (plan.duration_s > 0) trial.duration_s = plan.duration_s;
    if (plan.rate_Hz > 0) trial.rate_Hz = plan.rate_Hz;

    Run run;
    if (infos.empty()) {
        run = drive(trial, {}, make_plant);
    } else {
        // An effect whose size is its parameter needs no numbers of the robot without it.
        Run without;
        if (std::any_of(infos.begin(), infos.end(),
                        [](const EffectInfo* info) { return info->kind != SizeKind::value; })) {
            without = drive(trial, {}, make_plant);
        }
        std::vector<Sizing> sizings;
        for (std::size_t i = 0; i < infos.size(); ++i) {
            sizings.emplace_back(*infos[i], infos[i]->sizes[static_cast<std::size_t>(plan.sizes.at(i))],
                                 trial, without, random);
        }
        bool fits = false;
        for (int tries = 0; !fits; ++tries) {
            if (tries == kMostRuns) {
                throw CannotDraw(plan.id + ": no parameter gives " + plan.effects.front() +
                                 " the wanted size");
            }
            trial.hidden.effects.clear();
            for (const Sizing& sizing : sizings) trial.hidden.effects.push_back(sizing.effect());
            run = drive(trial, trial.hidden, make_plant);
            trial.reached.clear();
            fits = true;
            for (std::size_t i = 0; i < sizings.size(); ++i) {
                const double size = sizings[i].reached(run, i);
                trial.reached.push_back(size);
                if (sizings[i].fits(size)) continue;
                fits = false;
                sizings[i].improve(size);
            }
        }
    }
    take(std::move(run), trial);
    Random damage_random(plan.seed, plan.stream * 4 + 3);
    damage(trial, damage_random);
    return trial;
}

}  // namespace

Trial generate(const TrialPlan& plan, std::string_view plant_name, const PlantMaker& make_plant) {
    for (std::uint64_t draw = 0;; ++draw) {
        try {
            return drawn(plan, plant_name, make_plant, draw);
        } catch (const CannotDraw&) {
            if (draw + 1 == kMostDraws) throw;
        }
    }
}

Trial driven_again(const Trial& trial, double rate_Hz, const PlantMaker& make_plant) {
    Trial again = trial;
    again.rate_Hz = rate_Hz;
    take(drive(again, again.hidden, make_plant), again);
    return again;
}

Trial driven_through(const Trial& trial, const TorqueProgramme& programme, const PlantMaker& make_plant) {
    Trial again = trial;
    take(drive(trial, trial.hidden, make_plant, &programme), again);
    again.duration_s = programme.duration_s();
    return again;
}

std::string csv_text(const Trial& trial) {
    std::string text = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s";
    text += trial.gyro ? ",gyro_z_rad_s\n" : "\n";
    text.reserve(trial.samples.size() * 72);
    const auto add = [&text](double value, char end) {
        constexpr int kDigits = 6;
        std::array<char, 64> number{};
        const auto written = std::to_chars(number.data(), number.data() + number.size(), value,
                                           std::chars_format::fixed, kDigits);
        if (written.ec != std::errc{}) throw std::runtime_error("a number too large for a log");
        text.append(number.data(), written.ptr);
        text += end;
    };
    for (const Sample& s : trial.samples) {
        add(s.t_s, ',');
        add(s.torque_Nm.left, ',');
        add(s.torque_Nm.right, ',');
        add(s.speed_rad_per_s.left, ',');
        add(s.speed_rad_per_s.right, trial.gyro ? ',' : '\n');
        if (trial.gyro) add(s.gyro_rad_per_s, '\n');
    }
    return text;
}

std::string label_text(const Trial& trial, const OracleVerdict& oracle) {
    using Json = nlohmann::ordered_json;
    Json label;
    label["id"] = trial.plan.id;
    label["kind"] = name_of(trial.plan.kind);
    label["plant"] = trial.plant;
    label["seed"] = trial.plan.seed;
    label["stream"] = trial.plan.stream;
    label["effects"] = Json::array();
    for (std::size_t i = 0; i < trial.hidden.effects.size(); ++i) {
        const HiddenEffect& effect = trial.hidden.effects[i];
        Json parameters = Json::object();
        Json linear = Json::array();
        for (const ParameterInfo& info : find_effect(effect.name)->parameters()) {
            parameters[std::string(info.name)] = effect[info.name];
            if (info.linear) linear.push_back(info.name);
        }
        label["effects"].push_back({{"name", effect.name},
                                    {"size", name_of(trial.plan.sizes[i])},
                                    {"reached", trial.reached[i]},
                                    {"parameters", std::move(parameters)},
                                    {"linear", std::move(linear)}});
    }
    label["noise"] = kNoises[trial.plan.noise].name;
    label["motions"] = Json::array();
    for (const Motion motion : trial.motions) label["motions"].push_back(name_of(motion));
    label["duration_s"] = trial.duration_s;
    label["rate_Hz"] = trial.rate_Hz;
    label["gyro"] = trial.gyro;
    label["rms_torque_Nm"] = trial.rms_torque_Nm;
    label["peak_torque_Nm"] = trial.peak_torque_Nm;
    label["solver_complaints"] = trial.complaints;
    const Robot& r = trial.robot;
    label["robot"] = {{"wheel_radius_m", r.wheel_radius_m},
                      {"track_m", r.track_m},
                      {"mass_kg", r.mass_kg},
                      {"yaw_inertia_kg_m2", r.yaw_inertia_kg_m2},
                      {"cog_ahead_m", r.cog_ahead_m},
                      {"cog_height_m", r.cog_height_m},
                      {"wheel_mass_kg", r.wheel_mass_kg},
                      {"wheel_inertia_kg_m2", r.wheel_inertia_kg_m2},
                      {"castor_ahead_m", r.castor_ahead_m}};
    label["oracle"] = {{"identifiable", oracle.identifiable},
                       {"nearest_rival", oracle.nearest_rival},
                       {"unexplained_true", oracle.unexplained_true},
                       {"unexplained_none", oracle.unexplained_none},
                       {"unexplained_rival", oracle.unexplained_rival}};
    label["analyst"] = {{"wheel_radius_m", r.wheel_radius_m}, {"track_m", r.track_m}};
    return label.dump(2) + "\n";
}

}  // namespace wheelwright::hidden
