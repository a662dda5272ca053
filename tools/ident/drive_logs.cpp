// Identification from candump logs, with the firmware's own estimators: first the delay over the whole log,
// then K5..K8 and the effects with that delay. In the ident mode the same happens one after the other.
#include <algorithm>
#include <cmath>

#include "firmware/ident/cross_gains.hpp"
#include "firmware/ident/delay_estimator.hpp"
#include "firmware/ident/dynamics_estimator.hpp"
#include "firmware/task/cycle_schedule.hpp"
#include "firmware/task/learning.hpp"
#include "tools/cli/report.hpp"
#include "tools/ident/drive_log.hpp"
#include "tools/ident/drive_samples.hpp"
#include "tools/ident/findings.hpp"
#include "tools/ident/regression.hpp"

namespace wheelwright::tools {
namespace {

constexpr double kUnexcited = 0.5;          // of the prior variance that is left: the log said nothing
constexpr std::size_t kApart = 1'000'000;   // rows between stretches: beyond every lag
constexpr std::uint32_t kFewestRows = 200;  // as the estimator: below, it states no errors

ident::DynamicsEstimatorOptions<double> estimator_options(const IdentSetup& setup) {
    ident::DynamicsEstimatorOptions<double> options;
    options.filter = filter_options(setup.robot);
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        options.filter.effects.active[i] = options.filter.effects.active[i] || setup.effects[i];
    }
    options.relative_standard_error = setup.relative_standard_error;
    return options;
}

template <typename Estimator>
void feed(Estimator& estimator, const std::vector<DriveLog>& logs) {
    for (const DriveLog& log : logs) {
        estimator.restart();
        for (const DriveLog::Cycle& cycle : log.cycles) {
            if (cycle.restart) estimator.restart();
            estimator.push(cycle.sample);
        }
    }
}

// What an identification knows by its probe, here by the log: the angles' noise and, from a first estimate,
// how gently the wheels turn round, and how much of the torque is friction.
void size_by_log(const std::vector<DriveLog>& logs, double report_period_s,
                 const ident::DynamicsEstimate<double>& first,
                 ident::DynamicsEstimatorOptions<double>& options) {
    double noise_rad2 = 0, torque_Nm2 = 0, cycles = 0;
    for (const DriveLog& log : logs) {
        noise_rad2 = std::max(noise_rad2, angle_noise(log, 1).noise_rad2);
        for (const DriveLog::Cycle& cycle : log.cycles) {
            if (!cycle.sample.usable) continue;
            const WheelPair<double>& torque = cycle.sample.last_torque_Nm;
            torque_Nm2 += (torque.left * torque.left + torque.right * torque.right) / 2;
            ++cycles;
        }
    }
    const model::Geometry<double>& g = options.filter.geometry;
    const double usual_Nm = std::sqrt(torque_Nm2 / std::max(cycles, 1.0));
    const double friction_Nm = std::clamp(model::dry_friction_Nm(first.effects, g), 0.0, usual_Nm);
    const double weakest_per_Nm =
        std::min(2 * first.dynamics.k7_per_kg_m, first.dynamics.k8_per_kg_m2 * g.track_m) / g.mean_radius_m();
    if (!(weakest_per_Nm > 0)) return;
    const ident::SpeedSpan span =
        ident::speed_span(std::sqrt(noise_rad2), weakest_per_Nm * (usual_Nm - friction_Nm),
                          options.filter.sample_time_s, report_period_s);
    options.filter.speed_span = span.samples;
    options.filter.standing_samples = span.standing_samples;
    options.filter.standing_speed_rad_per_s = span.standing_speed_rad_per_s;
    options.dry_share = friction_Nm / usual_Nm;
}

// The rows of the firmware's filter, all at once, with the columns of DynamicsEstimator; what may wander
// there is constant here.
struct AllRows {
    Rows linear, turning;
};
enum Column : Eigen::Index {
    kVelocityProduct,
    kTorque,
    kSpread,
    kTiming,
    kCrossTiming,
    kCrossTorque,
    kFirstEffect
};

AllRows all_rows(const std::vector<DriveLog>& logs, ident::RegressionFilterOptions<double> options,
                 double tap_spacing_s) {
    using Filter = ident::RegressionFilter<double, ident::DynamicsEstimator<double>::kTaps>;
    options.tap_spacing_s = tap_spacing_s;
    Filter filter;
    filter.configure(options);
    std::vector<ident::RegressionRow<double, ident::DynamicsEstimator<double>::kTaps>> rows;
    std::vector<std::size_t> place;
    std::size_t now = 0;
    for (const DriveLog& log : logs) {
        filter.restart();
        now += kApart;
        for (const DriveLog::Cycle& cycle : log.cycles) {
            if (cycle.restart) {
                filter.restart();
                now += kApart;
            }
            if (!filter.push(cycle.sample)) continue;
            ++now;
            if (!filter.row().usable) continue;
            rows.push_back(filter.row());
            place.push_back(now);
        }
    }
    const auto fill = [&](auto&& combined, auto&& cross, auto&& left_side, auto&& velocity_product) {
        Rows to;
        to.phi.resize(static_cast<Eigen::Index>(rows.size()), kFirstEffect + filter.columns());
        to.y.resize(static_cast<Eigen::Index>(rows.size()));
        to.place = place;
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const auto& row = rows[i];
            const auto t = static_cast<Eigen::Index>(i);
            const std::array<double, 3> torque{combined(row.torque_Nm[0]), combined(row.torque_Nm[1]),
                                               combined(row.torque_Nm[2])};
            to.phi(t, kVelocityProduct) = velocity_product(row);
            to.phi(t, kTorque) = torque[1];
            to.phi(t, kSpread) = torque[0] + torque[2] - 2 * torque[1];
            to.phi(t, kTiming) = torque[2] - torque[0];
            to.phi(t, kCrossTiming) = cross(row.torque_Nm[2]) - cross(row.torque_Nm[0]);
            to.phi(t, kCrossTorque) = cross(row.torque_Nm[1]);
            for (int c = 0; c < filter.columns(); ++c) {
                to.phi(t, kFirstEffect + c) = combined(row.column[static_cast<std::size_t>(c)]);
            }
            to.y(t) = left_side(row);
        }
        return to;
    };
    const auto sum = [](const WheelPair<double>& pair) { return pair.sum(); };
    const auto difference = [](const WheelPair<double>& pair) { return pair.difference(); };
    return {fill(
                sum, difference, [](const auto& row) { return row.acceleration.v_m_per_s2; },
                [](const auto& row) { return row.omega_squared; }),
            fill(
                difference, sum, [](const auto& row) { return row.acceleration.omega_rad_per_s2; },
                [](const auto& row) { return row.v_omega; })};
}

void report_dynamics(const ident::DynamicsEstimate<double>& e, double prior, Findings& findings) {
    const auto each = [](const model::Dynamics<double>& k) {
        return std::array{k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
    };
    const auto value = each(e.dynamics);
    const auto error = each(e.standard_error);
    const auto diagonal = each(e.covariance_diagonal);
    for (std::size_t i = 0; i < findings.k.size(); ++i) {
        DynamicsFigure& k = findings.k[i];
        k.value = value[i];
        k.standard_error = error[i];
        k.covariance_diagonal = diagonal[i];
        k.excitation = 1 / std::sqrt(diagonal[i] * e.rows);
        if (diagonal[i] > kUnexcited * prior)
            k.reason = "not excited: this needs " + std::string(k.excited_by);
    }
}

// From the batch, whose fit says which directions the log leaves unknown; beside what the file lists of what
// couples forward and turning.
void report_effects(std::array<Fit, 2> equations, const IdentSetup& setup, double largest_torque_Nm,
                    Findings& findings) {
    std::array<ident::ColumnPlace, model::kMaxColumns> places{};
    const int columns = ident::column_places(setup.effects, places);
    const double k8_over_k7_per_m = findings.k8().value / findings.k7().value;
    std::vector<const Fit*> fits;
    for (std::size_t i = 0; i < equations.size(); ++i) {
        if (!findings.k[2 + i].known) continue;
        fits.push_back(&equations[i]);
        if (!findings.k7().known || !findings.k8().known) continue;
        for (int c = 0; c < columns; ++c) {
            const ident::ColumnPlace place = places[static_cast<std::size_t>(c)];
            equations[i].theta(kFirstEffect + c) /= ident::seen_of_one_wheel(
                model::side_of(place.effect, place.parameter), k8_over_k7_per_m,
                model::listed_mismatch(setup.robot.effects), model::listed_offset_m(setup.robot.effects),
                setup.robot.geometry.track_m)[i];
        }
    }
    const Shared shared = combine(fits, kTorque, kFirstEffect);
    for (int c = 0; c < columns; ++c) {
        const ident::ColumnPlace place = places[static_cast<std::size_t>(c)];
        EffectFigure figure;
        figure.effect = place.effect;
        figure.parameter = place.parameter;
        if (shared.value.size() > 0) {
            figure.value = shared.value(c);
            figure.standard_error = shared.error(c);
            // an error as large as half of all the torque there was: nothing is known
            figure.known = figure.standard_error < largest_torque_Nm / 2;
        }
        if (!figure.known) figure.reason = "the log does not tell it from the other parameters";
        findings.effects.push_back(std::move(figure));
    }
}

}  // namespace

Findings identify_drive_logs(const std::vector<std::string>& paths, const IdentSetup& setup) {
    Findings findings;
    std::vector<DriveLog> logs;
    double largest_torque_Nm = 0;
    for (const std::string& path : paths) {
        const DriveLog& log = logs.emplace_back(read_drive_log(path, setup.robot));
        for (const LineProblem& problem : log.problems) findings.problems.push_back(to_text(path, problem));
        for (const LineProblem& note : log.notes) findings.notes.push_back(to_text(path, note));
        findings.logs.push_back({path, "candump", log_date(1e-9 * static_cast<double>(log.first_time_ns)),
                                 1e-9 * static_cast<double>(log.last_time_ns - log.first_time_ns),
                                 1 / task::kCyclePeriod_s, log.cycles.size()});
        largest_torque_Nm = std::max(largest_torque_Nm, log.largest_torque_Nm);
    }
    if (!findings.problems.empty()) return findings;

    ident::DynamicsEstimatorOptions<double> options = estimator_options(setup);
    // of what the effects do not delay
    const double beside_s = options.filter.sample_age_s + model::effects_delay_s(setup.robot.effects);
    ident::DelayEstimator<double> delay_estimator;
    delay_estimator.configure(options.filter);
    feed(delay_estimator, logs);
    const ident::DelayEstimate<double> delay = delay_estimator.estimate();
    findings.delay_meaning = "from a cycle's start to the centroid of its torque";
    findings.delay_s = {static_cast<double>(delay.delay_s) - beside_s, delay.standard_error_s, delay.valid,
                        ""};
    if (delay.valid) {
        options.filter.delay_s = delay.delay_s;
    } else {
        findings.delay_s.value = options.filter.delay_s - beside_s;
        findings.delay_s.reason = "not measurable in this log; the robot file's is used";
    }

    ident::DynamicsEstimator<double> estimator;
    estimator.configure(options);
    feed(estimator, logs);
    size_by_log(logs, 1e-3 * setup.robot.drive.encoder_period_ms, estimator.estimate(), options);
    estimator.configure(options);
    feed(estimator, logs);
    const ident::DynamicsEstimate<double>& e = estimator.estimate();
    findings.rows = e.rows;
    findings.masked_rows = e.masked_rows;
    if (e.rows < kFewestRows) {
        findings.problems.push_back(to_text(
            paths[0], {0, "too short: " + std::to_string(e.rows) +
                              " rows in which both wheels turn, at least " + std::to_string(kFewestRows) +
                              " are needed (" + std::to_string(e.masked_rows) + " rows were left out)"}));
        return findings;
    }
    const int block = estimator.filter().block_samples();
    findings.averaged_over_s = 3 * block * options.filter.sample_time_s;
    const TwistRate<double> residual = estimator.residual_variance();
    findings.residual_rms = {std::sqrt(residual.v_m_per_s2), std::sqrt(residual.omega_rad_per_s2)};
    const AllRows rows = all_rows(logs, options.filter, estimator.tap_spacing_s());
    Fit linear = least_squares(rows.linear);
    Fit turning = least_squares(rows.turning);
    findings.explained_share = {linear.explained_share, turning.explained_share};
    report_dynamics(e, options.prior_variance, findings);
    judge(findings, setup.robot.geometry);
    report_effects({std::move(linear), std::move(turning)}, setup, largest_torque_Nm, findings);
    return findings;
}

}  // namespace wheelwright::tools
