// Identification from logs of torques and wheel speeds at any rate.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "firmware/ident/dynamics_estimate.hpp"
#include "tools/cli/report.hpp"
#include "tools/ident/findings.hpp"
#include "tools/ident/measured_signals.hpp"
#include "tools/ident/speed_rows.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kBlock_s = 0.01;  // rows this far apart, where the log is that fast
constexpr std::array kColours{0.0, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99};
constexpr double kLongestMemory_s = 2;  // of the filter the rows are seen through
constexpr double kMemoriesInLog = 20;   // at least
constexpr double kLongestDelay_s = 0.15;
constexpr double kMethodShare = 1e-3;  // of a value: what simulated logs without noise leave
constexpr std::size_t kRowsPerParameter = 8;
constexpr double kTurningOverNoise = 9;  // power of the yaw rate over that of its noise

// Columns of the effects, some of them merged: one unknown each.
struct Unknowns {
    std::array<ident::ColumnPlace, model::kMaxColumns> places{};
    int columns = 0;
    std::vector<std::vector<int>> groups;

    Eigen::Index column_of(int place) const {
        for (std::size_t g = 0; g < groups.size(); ++g) {
            if (std::find(groups[g].begin(), groups[g].end(), place) != groups[g].end()) {
                return kFirstEffect + static_cast<Eigen::Index>(g);
            }
        }
        return -1;
    }
};

struct Equations {
    Fit linear, turning;
    std::array<double, 2> torque_rms{};
    std::array<std::vector<double>, 2> column_rms;
    std::size_t rows = 0, masked = 0;
};

class Experiment {
  public:
    explicit Experiment(const IdentSetup& setup) : setup_(setup) {
        options_.geometry = setup.robot.geometry;
        options_.effects.active = setup.effects;
        unknowns_.columns = ident::column_places(options_.effects.active, unknowns_.places);
        for (int c = 0; c < unknowns_.columns; ++c) unknowns_.groups.push_back({c});
    }

    Findings run(const std::vector<std::string>& paths) {
        LogReading reading = setup_.reading;
        reading.wheel_radius_m = setup_.robot.geometry.wheel_radius_m;
        signals_ = look_at_measured_logs(paths, reading, findings_);
        if (good()) estimate();
        return std::move(findings_);
    }

  private:
    bool good() const { return findings_.problems.empty(); }

    Rows select(const Rows& from, bool with_slip) const {
        Rows to;
        const auto groups = static_cast<Eigen::Index>(unknowns_.groups.size());
        to.phi = Eigen::MatrixXd::Zero(from.phi.rows(), kFirstEffect + groups);
        to.phi.col(kVelocityProduct) = from.phi.col(kVelocityProduct);
        to.phi.col(kTorque) = from.phi.col(kTorque);
        if (with_slip) to.phi.col(kSlip) = from.phi.col(kSlip);
        for (Eigen::Index g = 0; g < groups; ++g) {
            for (const int c : unknowns_.groups[static_cast<std::size_t>(g)]) {
                to.phi.col(kFirstEffect + g) += from.phi.col(kFirstEffect + c);
            }
        }
        to.y = from.y;
        to.place = from.place;
        return to;
    }

    Equations fit(bool with_slip) const {
        const SpeedRows rows = make_speed_rows(signals_.runs, options_);
        Equations e;
        e.rows = rows.linear.place.size();
        e.masked = rows.masked;
        if (e.rows < kRowsPerParameter * (kFirstEffect + unknowns_.groups.size())) return e;
        const Rows linear = select(rows.linear, with_slip);
        const Rows turning = select(rows.turning, with_slip);
        e.linear = least_squares(whiten(linear, colour_[0]));
        e.turning = least_squares(whiten(turning, colour_[1]));
        const double n = std::sqrt(static_cast<double>(e.rows));
        for (std::size_t i = 0; i < 2; ++i) {
            const Eigen::MatrixXd& phi = i == 0 ? linear.phi : turning.phi;
            e.torque_rms[i] = phi.col(kTorque).norm() / n;
            for (Eigen::Index c = kFirstEffect; c < phi.cols(); ++c) {
                e.column_rms[i].push_back(phi.col(c).norm() / n);
            }
        }
        return e;
    }

    static double error(const Fit& fit, Eigen::Index i) {
        return fit.tells(i) && fit.covariance(i, i) > 0 ? std::sqrt(fit.covariance(i, i))
                                                        : std::numeric_limits<double>::infinity();
    }
    // K7 or K8 with so little doubt that one may divide by it.
    static bool firm(const Fit& fit) {
        return fit.rows > 0 && fit.theta(kTorque) > 0 && error(fit, kTorque) < fit.theta(kTorque) / 4;
    }

    static std::vector<const Fit*> firm_ones(const Equations& e) {
        std::vector<const Fit*> fits;
        for (const Fit* fit : {&e.linear, &e.turning}) {
            if (firm(*fit)) fits.push_back(fit);
        }
        return fits;
    }
    static Shared effects(const Equations& e) { return combine(firm_ones(e), kTorque, kFirstEffect); }

    static Ratio delay_step(const Equations& e) {
        double weight = 0;
        double sum = 0;
        for (const Fit* fit : firm_ones(e)) {
            const Ratio r = ratio(*fit, kSlip, kTorque);
            if (!fit->tells(kSlip) || !(r.variance > 0)) continue;
            weight += 1 / r.variance;
            sum += r.value / r.variance;
        }
        if (!(weight > 0)) return {0, std::numeric_limits<double>::infinity()};
        return {sum / weight, 1 / weight};
    }

    void set_block(double block_s) {
        options_.block =
            static_cast<std::size_t>(std::max(1.0, std::round(block_s / signals_.logs[0].period_s)));
    }
    double block_s() const { return static_cast<double>(options_.block) * signals_.logs[0].period_s; }

    void estimate() {
        set_block(kBlock_s);
        Equations first = fit(false);
        if (!enough(first)) return;
        choose_colour();
        first = fit(false);
        merge_sides(first);
        find_delay();
        merge_sides(fit(delay_known_));
        choose_colour();
        believe(fit(delay_known_));
        refine_delay();
        choose_colour();
        believe(fit(delay_known_));
        const Equations last = fit(delay_known_);
        if (enough(last)) report(last);
    }

    void believe(const Equations& e) {
        if (firm(e.linear)) options_.k7_per_kg_m = e.linear.theta(kTorque);
        if (firm(e.turning)) options_.k8_per_kg_m2 = e.turning.theta(kTorque);
    }

    bool enough(const Equations& e) {
        const std::size_t needed = kRowsPerParameter * (kFirstEffect + unknowns_.groups.size());
        if (e.rows >= needed) return true;
        findings_.problems.push_back(to_text(
            signals_.names[0],
            {0, "too short: " + std::to_string(e.rows) + " rows of " + number_text(block_s() * 1e3, 3) +
                    " ms in which both wheels turn, at least " + std::to_string(needed) + " are needed"}));
        return false;
    }

    // Left and right of one parameter become one unknown where the logs do not tell them apart.
    void merge_sides(const Equations& e) {
        for (int l = 0; l < unknowns_.columns; ++l) {
            for (int r = l + 1; r < unknowns_.columns; ++r) {
                const ident::ColumnPlace a = unknowns_.places[static_cast<std::size_t>(l)];
                const ident::ColumnPlace b = unknowns_.places[static_cast<std::size_t>(r)];
                if (a.effect != b.effect) continue;
                const auto& parameters = model::kEffects[a.effect].parameters;
                const std::string_view name = without_side(parameters[a.parameter].name);
                if (name.empty() || name != without_side(parameters[b.parameter].name)) continue;
                const Eigen::Index i = unknowns_.column_of(l);
                const Eigen::Index k = unknowns_.column_of(r);
                if (i != k && !tells_apart(e, i, k)) merge(l, r);
            }
        }
    }
    static bool tells_apart(const Equations& e, Eigen::Index i, Eigen::Index k) {
        if (!firm(e.turning)) return false;  // driven straight: only noise tells the wheels apart
        const Shared shared = effects(e);
        const Eigen::Index one = i - kFirstEffect;
        const Eigen::Index other = k - kFirstEffect;
        const double mean = std::abs(shared.value(one) + shared.value(other)) / 2;
        const auto c = static_cast<std::size_t>(one);
        const double scale = e.column_rms[0][c] > 0 ? e.torque_rms[0] / e.column_rms[0][c] : 0;
        return shared.error_of_difference(one, other) < std::max(mean / 2, 0.02 * scale);
    }
    void merge(int l, int r) {
        auto& groups = unknowns_.groups;
        const auto holds = [](int c) {
            return [c](const std::vector<int>& group) {
                return std::find(group.begin(), group.end(), c) != group.end();
            };
        };
        const auto from = std::find_if(groups.begin(), groups.end(), holds(r));
        const std::vector<int> moved = *from;
        groups.erase(from);
        const auto to = std::find_if(groups.begin(), groups.end(), holds(l));
        to->insert(to->end(), moved.begin(), moved.end());
    }

    static double misfit(const Equations& e) {
        double sum = 0;
        for (const Fit* fit : {&e.linear, &e.turning}) {
            if (firm(*fit)) sum += std::log(std::max(1 - fit->explained_share, 1e-12));
        }
        return sum;
    }

    void find_delay() {
        const double period = signals_.logs[0].period_s;
        double longest = kLongestDelay_s;
        for (const LogFacts& log : findings_.logs) longest = std::min(longest, log.duration_s / 10);
        double best = 0;
        double best_misfit = 1;
        for (double delay = -2 * period; delay <= longest; delay += std::max(block_s() / 4, period / 2)) {
            options_.delay_s = delay;
            const double value = misfit(fit(false));
            if (value < best_misfit) {
                best_misfit = value;
                best = delay;
            }
        }
        options_.delay_s = best;
        longest_delay_s_ = longest;
        refine_delay();
    }

    // Gauss-Newton on the delay: the slip column's coefficient is K times what is missing.
    void refine_delay() {
        delay_known_ = false;
        Ratio step;
        for (int i = 0; i < 8; ++i) {
            step = delay_step(fit(true));
            if (!std::isfinite(step.variance)) break;
            const double moved = std::clamp(step.value, -block_s(), block_s());
            options_.delay_s += moved;
            if (options_.delay_s < -3 * signals_.logs[0].period_s ||
                options_.delay_s > longest_delay_s_ + block_s()) {
                step.variance = std::numeric_limits<double>::infinity();
                break;
            }
            if (std::abs(moved) < 0.02 * std::sqrt(step.variance)) break;
        }
        delay_error_s_ = std::sqrt(step.variance);
        delay_known_ = delay_error_s_ < std::max(block_s(), 2 * signals_.logs[0].period_s);
        if (!delay_known_) options_.delay_s = 0;
    }

    // Through which filter each equation is seen best: the one that leaves the smallest error of K7 or K8.
    // Sensor noise asks for a long memory, forces that the model lacks for none.
    void choose_colour() {
        const SpeedRows rows = make_speed_rows(signals_.runs, options_);
        const std::array<const Rows*, 2> both{&rows.linear, &rows.turning};
        for (std::size_t i = 0; i < 2; ++i) {
            const Rows selected = select(*both[i], delay_known_);
            double best = std::numeric_limits<double>::infinity();
            for (const double colour : kColours) {
                const double memory_rows = 1 / (1 - colour);
                const Rows white = whiten(selected, colour);
                const auto count = static_cast<double>(white.place.size());
                if (memory_rows * block_s() > kLongestMemory_s || memory_rows * kMemoriesInLog > count) break;
                if (count <
                    static_cast<double>(kRowsPerParameter * static_cast<std::size_t>(white.phi.cols()))) {
                    break;
                }
                const Fit f = least_squares(white);
                const double doubt = firm(f) ? error(f, kTorque) / f.theta(kTorque) : 1.0;
                if (doubt < best) {
                    best = doubt;
                    colour_[i] = colour;
                }
            }
        }
    }

    // Straight lines between samples, reversals left out, a filter chosen by its result: none of that is in
    // the statistical errors. Half of what rows twice as long would change is added to them, and a share.
    Equations at_half_resolution() {
        const std::size_t block = options_.block;
        const std::array<double, 2> colour = colour_;
        options_.block = 2 * block;
        for (double& c : colour_) c *= c;
        Equations coarse = fit(delay_known_);
        options_.block = block;
        colour_ = colour;
        return coarse;
    }
    static double with_method_error(double statistical, double value, double coarse) {
        if (!std::isfinite(statistical)) return statistical;
        return std::hypot(statistical, (value - coarse) / 2, kMethodShare * value);
    }

    void report(const Equations& e) {
        const Equations coarse = at_half_resolution();
        const bool compare = coarse.linear.rows > 0;
        findings_.rows = e.rows;
        findings_.masked_rows = e.masked;
        findings_.averaged_over_s = (2 * static_cast<double>(options_.block) - 1) * signals_.logs[0].period_s;
        findings_.residual_rms = {std::sqrt(e.linear.residual_power), std::sqrt(e.turning.residual_power)};
        findings_.explained_share = {e.linear.explained_share, e.turning.explained_share};
        const std::array<const Fit*, 4> fits{&e.linear, &e.turning, &e.linear, &e.turning};
        for (std::size_t i = 0; i < 4; ++i) {
            const Eigen::Index column = i < 2 ? kVelocityProduct : kTorque;
            DynamicsFigure& k = findings_.k[i];
            k.value = fits[i]->theta(column);
            k.standard_error = error(*fits[i], column);
            const Fit& other = i % 2 == 0 ? coarse.linear : coarse.turning;
            if (compare && other.tells(column)) {
                k.standard_error = with_method_error(k.standard_error, k.value, other.theta(column));
            }
            k.covariance_diagonal = fits[i]->bare_diagonal(column);
            k.excitation = fits[i]->independent_rms(column);
            if (!fits[i]->tells(column)) k.reason = "not excited: this needs " + std::string(k.excited_by);
        }
        look_at_turning();
        judge(findings_, setup_.robot.geometry);
        report_effects(e, compare ? coarse : e);
        findings_.delay_meaning =
            "of a torque held from sample to sample; one measured at its sample shows minus half a sample";
        findings_.delay_s = {options_.delay_s, delay_error_s_, delay_known_,
                             delay_known_ ? "" : "the torque changes too little for it; taken as 0"};
    }

    void look_at_turning() {
        const model::Geometry<double>& g = setup_.robot.geometry;
        double power = 0;
        double count = 0;
        double gyro_power = 0;
        double with_gyro = 0;
        bool gyro = true;
        for (const MeasuredLog& log : signals_.logs) {
            gyro = gyro && log.has_gyro;
            for (const MeasuredSample& s : log.samples) {
                const double omega = model::twist_from_wheel_speeds(g, s.speed_rad_per_s).omega_rad_per_s;
                power += omega * omega;
                with_gyro += omega * s.gyro_rad_per_s;
                gyro_power += s.gyro_rad_per_s * s.gyro_rad_per_s;
                count += 1;
            }
        }
        const double noise =
            (g.wheel_radius_m.left * g.wheel_radius_m.left * signals_.speed_noise_power[0] +
             g.wheel_radius_m.right * g.wheel_radius_m.right * signals_.speed_noise_power[1]) /
            (g.track_m * g.track_m);
        // a gyro knows better than noisy wheels whether the robot turned
        const double turned = gyro ? std::min(power, gyro_power) / count : power / count;
        if (turned < kTurningOverNoise * noise / static_cast<double>(options_.block)) {
            for (std::size_t i = 0; i < 2; ++i) {
                if (findings_.k[i].reason.empty()) {
                    findings_.k[i].reason =
                        "not excited: the yaw rate is within the noise of the wheel speeds";
                }
            }
            return;
        }
        const double slope = with_gyro / power;
        if (gyro && gyro_power > 0 && std::abs(slope - 1) > 0.05 &&
            with_gyro * with_gyro > 0.5 * power * gyro_power) {
            findings_.notes.push_back(
                "the gyro reads " + number_text(slope, 3) +
                " times the yaw rate of the wheels: track or radii are not the robot's, "
                "or the wheels slip");
        }
    }

    void report_effects(const Equations& e, const Equations& coarse) {
        const Shared shared = effects(e);
        const Shared other = effects(coarse);
        for (int c = 0; c < unknowns_.columns; ++c) {
            const Eigen::Index column = unknowns_.column_of(c);
            const auto g = static_cast<std::size_t>(column - kFirstEffect);
            const ident::ColumnPlace place = unknowns_.places[static_cast<std::size_t>(c)];
            EffectFigure figure;
            figure.effect = place.effect;
            figure.parameter = place.parameter;
            figure.standard_error = std::numeric_limits<double>::infinity();
            const Eigen::Index at = column - kFirstEffect;
            if (shared.value.size() > 0) {
                figure.value = shared.value(at);
                figure.standard_error = shared.error(at);
            }
            if (other.value.size() > 0 && other.tells(at)) {
                figure.standard_error =
                    with_method_error(figure.standard_error, figure.value, other.value(at));
            }
            figure.common = unknowns_.groups[g].size() > 1;
            double scale = 0;
            for (std::size_t i = 0; i < 2; ++i) {
                if (e.column_rms[i][g] > 0) scale = std::max(scale, e.torque_rms[i] / e.column_rms[i][g]);
            }
            figure.known = figure.standard_error < scale / 2;
            if (!figure.known) {
                figure.reason = "the logs do not tell it from the other parameters";
            } else if (figure.common) {
                figure.reason = "left and right are not told apart: one value for both";
            }
            findings_.effects.push_back(std::move(figure));
        }
    }

    const IdentSetup& setup_;
    SpeedRowOptions options_;
    Unknowns unknowns_;
    Findings findings_;
    MeasuredSignals signals_;
    std::array<double, 2> colour_{};
    double longest_delay_s_ = 0;
    double delay_error_s_ = 0;
    bool delay_known_ = false;
};

}  // namespace

Findings identify_measured_logs(const std::vector<std::string>& paths, const IdentSetup& setup) {
    return Experiment(setup).run(paths);
}

}  // namespace wheelwright::tools
