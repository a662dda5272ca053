#include "tools/gap_exam/truth/exam_log.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <nlohmann/json.hpp>

namespace wheelwright::exam {
namespace {

// Torques and accelerations are compared as means that are weighed by a triangle, so far to either side: what
// swings faster is no torque that moves a robot.
constexpr double kWindow_s = 0.02;
// Speeds below this share of the fastest say nothing of a level of friction.
constexpr double kCreeping = 0.02;

constexpr double kNothing = 0.25, kOutside = 0.2;  // shares of the logs
constexpr double kLeastSize = 0.005, kLargestSize = 0.3;
constexpr double kNearSize = 1.2;  // a size is drawn, and what it comes out as is what counts
constexpr int kTries = 3;
constexpr double kHeldOut_s = 10;
// Two masses, and wheels on tyres: rotors that are so light swing faster than anybody logs.
constexpr double kLeastRotorShare = 0.1;

// Both wheels below each other: rows 2 k and 2 k + 1 are a window's.
struct Windows {
    Eigen::VectorXd asked, dry, viscous, ground, missing;  // Nm
    Eigen::VectorXd speed;                                 // rad/s
    Eigen::MatrixXd motion;                                // columns of K5..K8, as torques of no size
};

Windows windows_of(const Robot& robot, const Drive& drive) {
    const auto half =
        std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(kWindow_s / drive.period_s)));
    const std::size_t count = (drive.rows.size() - 1) / half - 1;
    const auto size = static_cast<Eigen::Index>(2 * count);
    Windows w;
    for (auto* column : {&w.asked, &w.dry, &w.viscous, &w.ground, &w.missing, &w.speed})
        column->setZero(size);
    w.motion.setZero(size, 4);
    const double r = robot.mean_radius_m();
    const double b = robot.track_m;
    const double moment = robot.mass_kg * robot.cog_ahead_m;
    for (std::size_t n = 0; n < count; ++n) {
        const auto row = static_cast<Eigen::Index>(2 * n);
        for (std::size_t k = 0; k < 2 * half; ++k) {
            const double from_middle = std::abs(static_cast<double>(k) + 0.5 - static_cast<double>(half)) /
                                       static_cast<double>(half);
            const double part = (1 - from_middle) / static_cast<double>(half);
            const Row& now = drive.rows[n * half + k];
            const Sides<double>& first = now.true_rad_per_s;
            const Sides<double>& last = drive.rows[n * half + k + 1].true_rad_per_s;
            const double v = r / 4 * (first[0] + first[1] + last[0] + last[1]);
            const double yaw = r / b / 2 * (first[1] - first[0] + last[1] - last[0]);
            const double v_rate = r / 2 * (last[0] + last[1] - first[0] - first[1]) / drive.period_s;
            const double yaw_rate = r / b * (last[1] - last[0] - first[1] + first[0]) / drive.period_s;
            const double force_N = robot.effective_mass_kg() * v_rate - moment * yaw * yaw;
            const double moment_Nm = robot.effective_inertia_kg_m2() * yaw_rate + moment * v * yaw;
            for (std::size_t i = 0; i < 2; ++i) {
                const auto at = row + static_cast<Eigen::Index>(i);
                const double side = i == 0 ? -1 : 1;
                const Resistance& resistance = now.resistance;
                const double needed_Nm = r * (force_N / 2 + side * moment_Nm / b);
                w.asked(at) += part * now.asked_Nm[i];
                w.dry(at) += part * resistance.dry_Nm[i];
                w.viscous(at) += part * resistance.viscous_Nm[i];
                w.ground(at) += part * resistance.ground_Nm[i];
                w.speed(at) += part * (first[i] + last[i]) / 2;
                w.missing(at) += part * (now.asked_Nm[i] - needed_Nm - resistance.dry_Nm[i] -
                                         resistance.viscous_Nm[i] - resistance.ground_Nm[i]);
                w.motion.row(at) +=
                    part * Eigen::RowVector4d(v_rate, side * yaw_rate, yaw * yaw, side * v * yaw);
            }
        }
    }
    return w;
}

// Each wheel has a column of its own.
Eigen::MatrixXd by_wheel(const Eigen::VectorXd& both) {
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(both.size(), 2);
    for (Eigen::Index k = 0; k < both.size(); ++k) columns(k, k % 2) = both(k);
    return columns;
}

Size size_of(const Eigen::VectorXd& torque, const Eigen::VectorXd& asked, const Eigen::MatrixXd& beside) {
    const Eigen::MatrixXd scaled =
        beside * beside.colwise().norm().cwiseMax(1e-300).cwiseInverse().asDiagonal();
    const Eigen::VectorXd left = torque - scaled * scaled.colPivHouseholderQr().solve(torque);
    return {torque.norm() / asked.norm(), left.norm() / asked.norm()};
}

template <typename... Columns>
Eigen::MatrixXd joined(const Columns&... columns) {
    const Eigen::Index rows = (columns.rows(), ...);
    Eigen::MatrixXd all(rows, (columns.cols() + ...));
    Eigen::Index at = 0;
    ((all.middleCols(at, columns.cols()) = columns, at += columns.cols()), ...);
    return all;
}

Further draw_further(Random& random) {
    const double kind = random.uniform();
    const std::size_t inside = random.below(kFirstOutside - 1);
    const std::size_t outside = random.below(kFurtherNames.size() - kFirstOutside);
    if (kind < kNothing) return Further::nothing;
    return static_cast<Further>(kind < kNothing + kOutside ? kFirstOutside + outside : 1 + inside);
}

void suit(Robot& robot, Random& random) {
    const double rotor = random.log_uniform(kLeastRotorShare, 0.4);
    if (robot.further == Further::wheel_slip || robot.further == Further::backlash ||
        robot.further == Further::elastic_shaft) {
        const double radius_m = robot.mean_radius_m();
        robot.wheel_inertia_kg_m2 = std::max(robot.wheel_inertia_kg_m2,
                                             robot.mass_kg * rotor / (1 - rotor) * radius_m * radius_m / 2);
    }
    if (robot.further == Further::stribeck_friction) {
        for (DryFriction& f : robot.dry) {
            if (f.law == DryLaw::tanh) f.law = DryLaw::makkar;  // that law has no static friction
            f.static_Nm = f.level_Nm;
        }
    }
}

bool changes_with_time(Further f) {
    return f == Further::payload_step || f == Further::gain_drift || f == Further::cold_grease ||
           f == Further::wind;
}

}  // namespace

Sizes sizes_in(const Robot& robot, const Drive& drive) {
    const Windows w = windows_of(robot, drive);
    const Eigen::MatrixXd dry = by_wheel(w.dry);
    const Eigen::MatrixXd viscous = by_wheel(w.viscous);
    return {size_of(w.dry, w.asked, joined(w.motion, viscous)),
            size_of(w.viscous, w.asked, joined(w.motion, dry)),
            size_of(w.missing, w.asked, joined(w.motion, dry, viscous)), w.ground.norm() / w.asked.norm()};
}

std::vector<Parameter> true_parameters(const Robot& robot, const Drive& drive) {
    std::vector<Parameter> known;
    const double r = robot.mean_radius_m();
    const double size = robot.amount * largest(robot);
    const double side = robot.draw[0] < 0.5 ? -1 : 1;
    const double lateral_m = robot.further == Further::cog_lateral ? size : 0;
    const double moment = robot.mass_kg * robot.cog_ahead_m;
    const double inertia = robot.effective_inertia_kg_m2() + robot.mass_kg * lateral_m * lateral_m;
    if (robot.further != Further::wheel_radius_mismatch) {  // K5..K8 of unequal wheels are a matter of words
        known.push_back({"", "k5_m", moment / robot.effective_mass_kg()});
        known.push_back({"", "k6_per_m", -moment / inertia});
        known.push_back({"", "k7_per_kg_m", 1 / (robot.effective_mass_kg() * r)});
        known.push_back({"", "k8_per_kg_m2", robot.track_m / (2 * r * inertia)});
    }
    switch (robot.further) {
        case Further::slope:
            known.push_back({"slope", "angle_rad", size});
            break;
        case Further::torque_bias:
            known.push_back({"torque_bias", "left_Nm", size * robot.share(0, -1, 1)});
            known.push_back({"torque_bias", "right_Nm", size * robot.share(1, -1, 1)});
            break;
        case Further::torque_gain_mismatch:
            known.push_back({"torque_gain_mismatch", "relative", side * size});
            break;
        case Further::wheel_radius_mismatch:
            known.push_back({"wheel_radius_mismatch", "relative", side * size});
            break;
        case Further::cog_lateral:
            known.push_back({"cog_lateral", "offset_m", side * size});
            break;
        case Further::payload_step:
            known.push_back({"payload_step", "mass_kg", size});
            break;
        default:
            break;
    }
    if (robot.further == Further::stribeck_friction || robot.further == Further::cold_grease ||
        robot.further == Further::load_dependent_friction) {
        return known;  // friction that is no level and no slope
    }
    const Windows w = windows_of(robot, drive);
    const double creeping = kCreeping * w.speed.cwiseAbs().maxCoeff();
    for (Eigen::Index wheel = 0; wheel < 2; ++wheel) {
        Eigen::Matrix2d products = Eigen::Matrix2d::Zero();
        Eigen::Vector2d right = Eigen::Vector2d::Zero();
        for (Eigen::Index k = wheel; k < w.speed.size(); k += 2) {
            if (std::abs(w.speed(k)) < creeping) continue;
            const Eigen::Vector2d column(std::copysign(1, w.speed(k)), w.speed(k));
            products += column * column.transpose();
            right += column * (w.dry(k) + w.viscous(k));
        }
        const Eigen::Vector2d x = products.ldlt().solve(right);
        const std::string name = wheel == 0 ? "left" : "right";
        known.push_back({"coulomb_friction", name + "_Nm", x(0)});
        known.push_back({"viscous_friction", name + "_Nm_s_per_rad", x(1)});
    }
    return known;
}

ExamLog draw_log(std::uint64_t seed, std::size_t number) {
    const std::uint64_t own = Random(seed, number).bits();
    auto stream = [own, next = std::uint64_t{0}]() mutable { return Random(own, next++); };
    Random robot_stream = stream();
    Random further_stream = stream();
    Random sensor_stream = stream();
    Random driving_stream = stream();
    Random learned_stream = stream();
    Random held_out_stream = stream();
    Random ground_stream = stream();

    ExamLog log;
    log.number = number;
    log.robot = draw_robot(robot_stream);
    log.robot.further = draw_further(further_stream);
    const double wanted_size = further_stream.log_uniform(kLeastSize, kLargestSize);
    suit(log.robot, further_stream);
    log.sensors = draw_sensors(sensor_stream, log.robot);
    log.driving = draw_driving(driving_stream, log.sensors);
    const Wanted wanted = draw_motion(learned_stream, log.robot, log.driving, log.sensors.period_s);
    const std::uint64_t ground_seed = ground_stream.bits();
    Sizes sizes;
    if (log.robot.further != Further::nothing) log.robot.amount = wanted_size;
    for (int k = 0; k < kTries; ++k) {
        log.learned = drive(log.robot, log.sensors, log.driving, wanted, ground_seed);
        sizes = sizes_in(log.robot, log.learned);
        const double off = sizes.further.share / wanted_size;
        const bool at_its_end = log.robot.amount == 1 && off < 1;
        if (log.robot.further == Further::nothing || at_its_end || (off < kNearSize && off > 1 / kNearSize))
            break;
        if (k + 1 < kTries)
            log.robot.amount = std::min(1.0, log.robot.amount * std::clamp(1 / off, 0.1, 10.0));
    }
    log.dry = sizes.dry;
    log.viscous = sizes.viscous;
    log.ground_share = sizes.ground_share;
    if (log.robot.further != Further::nothing) log.further = sizes.further;

    Sensors whole = log.sensors;  // what is compared with has all its rows
    whole.dropped = whole.jitter_s = 0;
    Driving held = log.driving;
    std::rotate(
        held.motions.begin(),
        held.motions.begin() + static_cast<std::ptrdiff_t>(held_out_stream.below(held.motions.size())),
        held.motions.end());
    held.motions.resize(std::min<std::size_t>(2, held.motions.size()));
    held.each_s = kHeldOut_s / static_cast<double>(held.motions.size());
    log.held_out =
        drive(log.robot, whole, held, draw_motion(held_out_stream, log.robot, held, log.sensors.period_s),
              ground_stream.bits());
    log.comparable = !changes_with_time(log.robot.further);
    log.true_rms_rad_per_s = true_free_run_rms(log.robot, log.sensors, log.held_out);
    log.parameters = true_parameters(log.robot, log.learned);
    const Further f = log.robot.further;
    const bool late =
        f == Further::actuator_lag || f == Further::transport_delay || f == Further::measurement_lag;
    log.late_s = 2 / log.sensors.tracking_rad_per_s + (late ? log.robot.amount * largest(log.robot) : 0);
    return log;
}

std::string truth_json(const ExamLog& log) {
    using Json = nlohmann::ordered_json;
    const auto size = [](const Size& s) { return Json{{"share", s.share}, {"visible", s.visible}}; };
    const Robot& r = log.robot;
    Json motions = Json::array();
    for (const Motion m : log.driving.motions) motions.push_back(kMotionNames[static_cast<std::size_t>(m)]);
    Json parameters = Json::array();
    for (const Parameter& p : log.parameters)
        parameters.push_back({{"effect", p.effect}, {"name", p.name}, {"value", p.value}});
    constexpr std::array kLaws{"tanh", "makkar", "lugre"};
    const Json json{{"number", log.number},
                    {"further", name_of(r.further)},
                    {"amount", r.amount * largest(r)},
                    {"sizes",
                     {{"dry", size(log.dry)},
                      {"viscous", size(log.viscous)},
                      {"further", size(log.further)},
                      {"ground", log.ground_share}}},
                    {"robot",
                     {{"mass_kg", r.mass_kg},
                      {"yaw_inertia_kg_m2", r.yaw_inertia_kg_m2},
                      {"cog_ahead_m", r.cog_ahead_m},
                      {"wheel_inertia_kg_m2", r.wheel_inertia_kg_m2},
                      {"wheel_radius_m", r.mean_radius_m()},
                      {"track_m", r.track_m},
                      {"torque_limit_Nm", r.torque_limit_Nm},
                      {"top_speed_rad_per_s", r.top_speed_rad_per_s},
                      {"dry_law", kLaws[static_cast<std::size_t>(r.dry[0].law)]},
                      {"dry_Nm", {r.dry[0].level_Nm, r.dry[1].level_Nm}},
                      {"static_Nm", {r.dry[0].static_Nm, r.dry[1].static_Nm}},
                      {"viscous_Nm_s_per_rad", r.viscous_Nm_s_per_rad}}},
                    {"sensors",
                     {{"period_s", log.sensors.period_s},
                      {"counts_per_turn", log.sensors.counts_per_turn},
                      {"tracking_rad_per_s", log.sensors.tracking_rad_per_s},
                      {"noise_rad_per_s", log.sensors.noise_rad_per_s},
                      {"noise_time_s", log.sensors.noise_time_s},
                      {"gyro", log.sensors.gyro},
                      {"jitter_s", log.sensors.jitter_s},
                      {"dropped", log.sensors.dropped}}},
                    {"motions", motions},
                    {"late_s", log.late_s},
                    {"true_rms_rad_per_s", log.true_rms_rad_per_s},
                    {"parameters", parameters}};
    return json.dump(2) + "\n";
}

}  // namespace wheelwright::exam
