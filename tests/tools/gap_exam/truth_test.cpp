// The exam's plant and sensors against published numbers and mechanics worked out here.
#include <cmath>

#include "tools/gap_exam/truth/exam_log.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::exam;

namespace {

// No friction and nothing else, until a test gives it some.
Robot bare() {
    Robot r;
    r.mass_kg = 12;
    r.yaw_inertia_kg_m2 = 0.5;
    r.cog_ahead_m = 0.08;
    r.wheel_inertia_kg_m2 = 0.01;
    r.wheel_radius_m = {0.1, 0.1};
    r.track_m = 0.5;
    r.torque_limit_Nm = 2;
    r.top_speed_rad_per_s = 15;
    r.draw = {0.75, 0.5, 0.5, 0.5};
    return r;
}

Robot with(Further further, double size) {
    Robot r = bare();
    r.further = further;
    r.amount = size / largest(r);
    return r;
}

double inertia_of_a_wheel(const Robot& r) {  // of the robot that goes straight
    return (r.mass_kg * 0.01 + 2 * r.wheel_inertia_kg_m2) / 2;
}

void advance(Simulator& plant, double left_Nm, double right_Nm, double duration_s) {
    for (int k = 0; k < std::lround(duration_s / 0.001); ++k) plant.advance({left_Nm, right_Nm}, 0.001);
}

Sensors fine() {
    Sensors s;
    s.period_s = 0.005;
    s.counts_per_turn = 1e8;
    s.tracking_rad_per_s = 800;
    return s;
}

Drive driven(const Robot& robot, const Sensors& sensors) {
    const Driving driving{{Motion::steps, Motion::figure_eight}, 8, 5};
    Random random(4);
    return drive(robot, sensors, driving, draw_motion(random, robot, driving, sensors.period_s), 1);
}

void give_friction(Robot& r) {
    for (auto& dry : r.dry) dry = {DryLaw::tanh, 0.15, 0.15, 1, 0.05, 0, 0};
    r.viscous_Nm_s_per_rad = {0.01, 0.01};
}

}  // namespace

TEST_GROUP(ExamLaws){};

// Canudas de Wit, Olsson, Astrom, Lischinsky (1995), table 1.
TEST(ExamLaws, LuGreAtSteadySpeedIsItsLevel) {
    const DryFriction f{DryLaw::lugre, 1, 1.5, 0.001, 0, 1e5, std::sqrt(1e5)};
    for (const double speed : {-0.003, 0.0005, 0.001, 0.1}) {
        const double level = 1 + 0.5 * std::exp(-speed * speed / 1e-6);
        const double bend = std::copysign(level / 1e5, speed);
        DOUBLES_EQUAL(0, lugre_bend_rate(f, bend, speed), 1e-12);
        DOUBLES_EQUAL(std::copysign(level, speed), dry_torque_Nm(f, bend, speed), 1e-9);
    }
    DOUBLES_EQUAL(1.18394, lugre_level_Nm(f, 0.001), 1e-5);  // 1 + 0.5 / e
}

TEST(ExamLaws, MakkarRisesWhenCreepingAndFallsToItsLevel) {
    const DryFriction f{DryLaw::makkar, 1, 1.4, 1, 0.05, 0, 0};
    DOUBLES_EQUAL(1, dry_torque_Nm(f, 0, 20), 1e-9);
    DOUBLES_EQUAL(-1, dry_torque_Nm(f, 0, -20), 1e-9);
    // between its two tanh's: 1 + 0.4 (1 - tanh 0.2)
    DOUBLES_EQUAL(1 + 0.4 * (1 - std::tanh(0.2)), dry_torque_Nm(f, 0, 0.2), 1e-3);
}

// B C D is the slope at zero, D the peak; the value between is worked out by hand with the usual numbers for
// a dry road.
TEST(ExamLaws, MagicFormula) {
    const MagicFormula dry{10, 1.9, 1, 0.97};
    DOUBLES_EQUAL(19, magic_formula(dry, 1e-5) / 1e-5, 1e-3);
    DOUBLES_EQUAL(0.9558, magic_formula(dry, 0.1), 2e-4);
    double peak = 0;
    for (double slip = 0; slip < 1; slip += 0.001) peak = std::max(peak, magic_formula(dry, slip));
    DOUBLES_EQUAL(1, peak, 1e-5);
}

TEST_GROUP(ExamPlant){};

TEST(ExamPlant, KeepsItsEnergyWhenNothingTakesAny) {
    for (const Robot& r :
         {bare(), with(Further::cog_lateral, 0.1), with(Further::wheel_radius_mismatch, 0.2)}) {
        Simulator plant(r, 1, false);
        plant.set_motion(0.8, 3);
        const double before_J = plant.kinetic_energy_J();
        advance(plant, 0, 0, 3);
        CHECK(std::abs(plant.yaw_rate_rad_per_s() - 3) > 0.1);  // it does move from the one to the other
        DOUBLES_EQUAL(before_J, plant.kinetic_energy_J(), 1e-8 * before_J);
    }
}

TEST(ExamPlant, TakesTheWorkThatIsDone) {
    Robot r = bare();
    give_friction(r);
    Simulator plant(r, 1, false);
    double work_J = 0;
    for (int k = 0; k < 4000; ++k) {
        const double t_s = 0.001 * k;
        const Sides<double> asked{1.2 * std::sin(3 * t_s), std::cos(2 * t_s)};
        const Sides<double> before = plant.angle_rad();
        plant.advance(asked, 0.001);
        for (std::size_t i = 0; i < 2; ++i) {
            const double taken_Nm = plant.resistance().dry_Nm[i] + plant.resistance().viscous_Nm[i];
            work_J += (asked[i] - taken_Nm) * (plant.angle_rad()[i] - before[i]);
        }
    }
    DOUBLES_EQUAL(work_J, plant.kinetic_energy_J(), 1e-3 * work_J);
}

TEST(ExamPlant, ViscousFrictionAlone) {
    Robot r = bare();
    r.viscous_Nm_s_per_rad = {0.05, 0.05};
    Simulator plant(r, 1, false);
    advance(plant, 0.6, 0.6, 1.5);
    DOUBLES_EQUAL(0.6 / 0.05 * (1 - std::exp(-1.5 * 0.05 / inertia_of_a_wheel(r))),
                  plant.speed_rad_per_s()[0], 1e-6);
}

TEST(ExamPlant, Slope) {
    Robot r = with(Further::slope, 0.05);
    r.draw[0] = 0;  // straight uphill
    Simulator plant(r, 1, false);
    advance(plant, 0, 0, 0.5);
    DOUBLES_EQUAL(-9.80665 * std::sin(0.05) * r.mass_kg / (r.mass_kg + 2) * 0.5, plant.forward_m_per_s(),
                  1e-6);
}

TEST(ExamPlant, LoadMakesItHeavier) {
    Robot r = with(Further::payload_step, 6);
    r.draw[0] = 0;  // after 8 s
    Simulator plant(r, 1, false);
    advance(plant, 0, 0, 9);
    advance(plant, 0.5, 0.5, 1);
    DOUBLES_EQUAL(2 * 0.5 / 0.1 / (12 + 6 + 2), plant.forward_m_per_s(), 1e-6);
}

// A castor that is pulled follows the tractrix: the tangent of half its angle falls by e in a trail.
TEST(ExamPlant, CastorFollowsTheTractrix) {
    Robot r = bare();
    r.further = Further::castor_drag;
    r.amount = 0;
    r.mass_kg = 50;
    r.draw = {0, 0.5, 0.5, 0.5};
    const double trail_m = 0.14 * r.track_m;
    Simulator plant(r, 1, false);
    plant.set_motion(0.8, 0);
    plant.set_fork(1.5);
    double way_m = 0;
    for (int k = 0; k < 150; ++k) {
        plant.advance({0, 0}, 0.001);
        way_m += 0.001 * plant.forward_m_per_s();
    }
    DOUBLES_EQUAL(std::tan(0.75) * std::exp(-way_m / trail_m), std::tan(plant.fork_rad() / 2), 0.03);
    CHECK(plant.fork_rad() < 0.7);
}

// Until the teeth meet, the motor turns alone; then both are one.
TEST(ExamPlant, Backlash) {
    const Robot r = with(Further::backlash, 0.05);
    Simulator plant(r, 1, false);
    const double motor_kg_m2 = 0.8 * r.wheel_inertia_kg_m2;
    const double meets_s = std::sqrt(2 * 0.05 * motor_kg_m2 / 0.5);
    advance(plant, 0.5, 0.5, 0.9 * meets_s);
    DOUBLES_EQUAL(0, plant.speed_rad_per_s()[0], 1e-12);
    advance(plant, 0.5, 0.5, 0.5 * meets_s);
    CHECK(plant.speed_rad_per_s()[0] > 0);
    advance(plant, 0.5, 0.5, 2 - 1.4 * meets_s);
    DOUBLES_EQUAL(0.5 * 2 / inertia_of_a_wheel(r), plant.speed_rad_per_s()[0],
                  0.01 * plant.speed_rad_per_s()[0]);
}

TEST(ExamPlant, DelayIsItsMean) {
    const Robot r = with(Further::transport_delay, 0.02);
    Simulator plant(r, 1, false);
    advance(plant, 0.5, 0.5, 0.0155);
    DOUBLES_EQUAL(0, plant.speed_rad_per_s()[0], 1e-12);
    advance(plant, 0.5, 0.5, 1 - 0.0155);
    DOUBLES_EQUAL(0.5 * 0.98 / inertia_of_a_wheel(r), plant.speed_rad_per_s()[0],
                  0.005 * plant.speed_rad_per_s()[0]);
}

// A tyre slips by what its stiffness, and the damping of its rubber, make of the force.
TEST(ExamPlant, TyreSlipsByTheForceOnIt) {
    Robot r = with(Further::wheel_slip, 0.1);
    r.viscous_Nm_s_per_rad = {0, 0};
    Simulator plant(r, 1, false);
    plant.set_motion(1, 0);
    advance(plant, 0.4, 0.4, 0.5);
    const double acceleration_m_per_s2 = 2 * 0.4 / 0.1 / (r.mass_kg + 2);
    const double force_N = r.mass_kg * acceleration_m_per_s2 / 2;
    const double load_N = r.mass_kg * 9.80665 * (0.35 + 0.1 * r.draw[0]);
    const double stiffness = 15 * 1.6 * (0.5 + 0.4 * r.draw[1]) * load_N;  // B C D, times load
    const double speed_m_per_s = plant.forward_m_per_s();
    const double slip = plant.speed_rad_per_s()[0] * 0.1 / speed_m_per_s - 1;
    // Rubber has 0.8 of the damping that a wheel's rotation, as a mass, and the tyre's spring over 0.3 radii
    // make.
    const double wheel_kg = r.wheel_inertia_kg_m2 / (0.1 * 0.1);
    const double rubber = 0.8 * std::sqrt(stiffness / (0.3 * 0.1) * wheel_kg) * speed_m_per_s;
    DOUBLES_EQUAL(force_N / (stiffness + rubber), slip, 0.03 * slip);
}

TEST_GROUP(ExamLogs){};

TEST(ExamLogs, NothingFurtherTakesNoTorque) {
    Robot r = bare();
    give_friction(r);
    r.rough_Nm = 0.03;
    const Sizes sizes = sizes_in(r, driven(r, fine()));
    CHECK(sizes.dry.share > 0.05);
    CHECK(sizes.ground_share > 0.005);
    CHECK(sizes.further.share < 0.002);
}

// What a drive gives too little or too much of is a share of the torque that does not depend on the motion.
TEST(ExamLogs, SizeOfAGainMismatch) {
    Robot r = with(Further::torque_gain_mismatch, 0.25);
    give_friction(r);
    const Sizes sizes = sizes_in(r, driven(r, fine()));
    DOUBLES_EQUAL(0.25 / 2.25, sizes.further.share, 0.001);
    CHECK(sizes.further.visible < sizes.further.share);
    CHECK(sizes.further.visible > 0.02);
}

TEST(ExamLogs, FrictionAsLeastSquaresAndMassesAsK) {
    Robot r = bare();
    give_friction(r);
    for (const Parameter& p : true_parameters(r, driven(r, fine()))) {
        if (p.effect == "coulomb_friction") DOUBLES_EQUAL(0.15, p.value, 0.001);
        if (p.effect == "viscous_friction") DOUBLES_EQUAL(0.01, p.value, 0.0002);
        if (p.name == "k7_per_kg_m") DOUBLES_EQUAL(1 / (0.1 * (12 + 2)), p.value, 1e-9);
        if (p.name == "k8_per_kg_m2")
            DOUBLES_EQUAL(0.5 / (0.2 * (0.5 + 12 * 0.0064 + 0.01 * 0.25 / 0.02)), p.value, 1e-9);
    }
}

TEST(ExamLogs, TheTrueRobotRunsWhereItsSensorsAreFineAndTheFloorIsEven) {
    Robot r = bare();
    give_friction(r);
    CHECK(true_free_run_rms(r, fine(), driven(r, fine())) < 0.001 * r.top_speed_rad_per_s);
    r.rough_Nm = 0.05;
    CHECK(true_free_run_rms(r, fine(), driven(r, fine())) > 0.002 * r.top_speed_rad_per_s);
}

// Critically damped: a ramp of speed is reported late by two over the bandwidth.
TEST(ExamLogs, EncoderLoopIsLate) {
    Tracking loop(200);
    constexpr double kStep_s = 1e-5;
    for (int k = 1; k <= 100000; ++k) loop.take(k * kStep_s * k * kStep_s / 2, kStep_s);  // speed is the time
    DOUBLES_EQUAL(1 - 2.0 / 200, loop.speed_rad_per_s(), 1e-4);
}

TEST(ExamLogs, ASeedAndANumberAreALog) {
    const ExamLog log = draw_log(5, 3);
    const ExamLog again = draw_log(5, 3);
    STRCMP_EQUAL(csv(log.learned).c_str(), csv(again.learned).c_str());
    STRCMP_EQUAL(csv(log.held_out).c_str(), csv(again.held_out).c_str());
    STRCMP_EQUAL(truth_json(log).c_str(), truth_json(again).c_str());
}

// Drawn robots are what docs/gap-exam.md says.
TEST(ExamLogs, RobotsAreDrawnWithinTheirBounds) {
    double lightest = 1e9;
    double heaviest = 0;
    for (std::uint64_t k = 0; k < 300; ++k) {
        Random random(9, k);
        const Robot r = draw_robot(random);
        lightest = std::min(lightest, r.mass_kg);
        heaviest = std::max(heaviest, r.mass_kg);
        const double friction =
            (r.dry[0].level_Nm + r.viscous_Nm_s_per_rad[0] * r.top_speed_rad_per_s) / r.torque_limit_Nm;
        CHECK(friction > 0.02 * 0.85 && friction < 0.25 * 1.15);
        CHECK(r.wheel_radius_m[0] >= 0.025 && r.wheel_radius_m[0] <= 0.2);
    }
    CHECK(lightest < 1.2 && heaviest > 170);
}
