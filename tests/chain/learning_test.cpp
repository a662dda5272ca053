// What the cycle does with what is learned while it is learned: whose model drives, brakes and watches.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>

#include "tests/chain/scene.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;
using protocol::Fault;
using protocol::Mode;

TEST_GROUP(ChainLearning){};

using namespace chain;

namespace {

constexpr Layout kShared{false, 0, 1};

double plant_k7(const Scene& scene) {
    return const_cast<Scene&>(scene).sim.cycle().control().plant().dynamics.k7_per_kg_m;
}

// Nothing is known of it but its file's geometry and limits; a stop message brakes.
model::RobotParameters unknown_robot() {
    model::RobotParameters p = chain::believed().parameters;
    p.dynamics = model::default_parameters().dynamics;
    p.safety.emergency_stop_reaction = model::StopReaction::ramp;
    return p;
}

// Until the robot rolls, in an identification after its probe.
void identify_until_it_rolls(Scene& scene) {
    CHECK(enter_mode(scene.sim, Mode::ident));
    CHECK(scene.sim.run_until(
        [&] {
            return scene.sim.cycle().learning().run().state() == ident::IdentState::estimating &&
                   scene.rim_speed() > 0.3;
        },
        30));
}

}  // namespace

TEST(ChainLearning, an_unknown_robot_is_driven_and_braked_by_what_the_probe_has_found_and_no_longer) {
    Scene scene(kShared, 41, unknown_robot());
    const double guess = plant_k7(scene);
    CHECK(enter_mode(scene.sim, Mode::ident));
    int before = 0, after = 0;
    while (after < 3000) {
        scene.sim.run_for(0.001);
        CHECK(scene.sim.cycle().supervisor().may_drive());
        const double found = scene.sim.cycle().learning().run().findings().k7_per_kg_m;
        if (scene.sim.cycle().learning().probed()) {
            ++after;
            DOUBLES_EQUAL(found, plant_k7(scene), 1e-6 * found);
        } else {
            ++before;
            CHECK(plant_k7(scene) < 0.01 * guess);  // predicts nothing
        }
    }
    CHECK(before > 300);
    CHECK(scene.sim.run_until([&] { return scene.rim_speed() > 0.3; }, 10));
    scene.sim.host().emergency_stop();
    Scene::Worst braking = scene.run(1.5);
    CHECK(scene.fault() == Fault::emergency_stop_message);
    CHECK(braking.last_torque_s > 0.03);
    CHECK(scene.rim_speed() < 0.01);

    // A parameter that takes effect brings the file's guess back, by which nobody brakes.
    scene.sim.host().clear_fault();
    scene.sim.run_for(0.2);
    scene.sim.host().parameter(protocol::ParameterOperation::write,
                               model::find_parameter("limits.torque_Nm")->index, 2.5F);
    scene.sim.host().parameter(protocol::ParameterOperation::commit, 0);
    scene.sim.run_for(0.2);
    DOUBLES_EQUAL(guess, plant_k7(scene), 0);
    scene.sim.host().torque({1.2, 1.2});
    CHECK(enter_mode(scene.sim, Mode::torque));
    CHECK(scene.sim.run_until([&] { return scene.rim_speed() > 0.3; }, 5));
    scene.sim.host().emergency_stop();
    braking = scene.run(0.5);
    CHECK(scene.fault() == Fault::emergency_stop_message);
    CHECK(braking.last_torque_s < 0.005);
}

TEST(ChainLearning, a_known_robot_keeps_its_model_until_a_new_one_is_found) {
    Scene scene(kShared, 42);
    const double known = plant_k7(scene);
    protocol::IdentSettings settings;
    settings.amplitude_Nm = 0.75;
    scene.sim.host().ident(settings);
    identify_until_it_rolls(scene);
    DOUBLES_EQUAL(0.75, scene.sim.cycle().learning().run().sizing().amplitude_Nm, 1e-3);
    scene.run(2, [&] { DOUBLES_EQUAL(known, plant_k7(scene), 0); });
    CHECK(enter_mode(scene.sim, Mode::idle));
    CHECK(scene.sim.cycle().learning().run().cause() == protocol::IdentCause::interrupted);
    DOUBLES_EQUAL(known, plant_k7(scene), 0);
}

namespace {

// What an identification leaves in the file, of the truth's friction 3 % too much.
model::RobotParameters identified_with_friction() {
    model::RobotParameters p = identified();
    for (const char* name : {"coulomb_friction", "viscous_friction"}) {
        const std::size_t i = model::find_effect(name);
        p.effects.active[i] = true;
        for (double& value : p.effects.parameter[i] = real().parameters.effects.parameter[i]) value *= 1.03;
    }
    p.velocity_loop.angle_noise_rad = 1e-4;
    return p;
}

}  // namespace

// Its encoders are watched by the known model, not by what the run itself notices in a while.
TEST(ChainLearning, a_known_robots_identification_ends_soon_where_an_encoder_freezes) {
    const model::RobotParameters known = identified_with_friction();
    double longest_s = 0;
    for (unsigned seed = 43; seed < 53; ++seed) {
        for (const std::size_t side : {0U, 1U}) {
            Scene scene(kShared, seed, known);
            identify_until_it_rolls(scene);
            scene.sim.world().drive(side).faults().frozen_encoder = true;
            const auto angle = [&] {
                const auto& both = scene.world().plant().wheel_angle_rad();
                return side == 0 ? both.left : both.right;
            };
            const double told_rad = angle();
            CHECK(scene.sim.run_until(
                [&] {
                    return std::abs(angle() - told_rad) > kMostUnseen_rad || scene.fault() != Fault::none;
                },
                1));
            const Scene::Worst worst = scene.run(1);
            CHECK(scene.fault() == Fault::encoder_implausible);
            CHECK(scene.sim.cycle().learning().run().cause() == protocol::IdentCause::interrupted);
            CHECK_TEXT(worst.last_torque_s <= 0.1, std::to_string(worst.last_torque_s).c_str());
            longest_s = std::max(longest_s, worst.last_torque_s);
        }
    }
    std::printf("  torque for %.0f ms at most\n", 1e3 * longest_s);
}

// The probe ends by it before the watch does; a brake over such an encoder would speed the wheel up. One that
// has found nothing wrong is braked.
TEST(ChainLearning, nobody_brakes_over_an_encoder_that_an_identification_has_found_to_lie) {
    for (const std::size_t side : {0U, 1U}) {
        Scene scene(kShared, 45);
        scene.sim.world().drive(side).reverse_encoder();
        CHECK(enter_mode(scene.sim, Mode::ident));
        const ident::IdentificationRun<Real>& run = scene.sim.cycle().learning().run();
        CHECK(scene.sim.run_until([&] { return run.finished(); }, 10));
        CHECK(run.cause() == (side == 0 ? protocol::IdentCause::left_wheel_against_torque
                                        : protocol::IdentCause::right_wheel_against_torque));
        CHECK(scene.rim_speed() > 0.001);  // there was something to brake
        const Scene::Worst worst = scene.run(0.5);
        CHECK(worst.last_torque_s <= 0.005);
        CHECK(scene.fault() == Fault::none);
    }
    Scene healthy(kShared, 45);
    identify_until_it_rolls(healthy);
    healthy.sim.host().mode(Mode::idle);
    CHECK(healthy.run(1).last_torque_s > 0.03);
    CHECK(healthy.rim_speed() < 0.01);
}

TEST(ChainLearning, after_an_encoder_that_counted_the_other_way_the_robot_drives_again) {
    for (const std::size_t side : {0U, 1U}) {
        Scene scene(kShared, 44);
        scene.cruise(0.5);
        scene.sim.world().drive(side).reverse_encoder();
        scene.run(1);
        CHECK(scene.fault() == Fault::encoder_implausible);
        scene.sim.world().drive(side).reverse_encoder();
        scene.sim.run_for(3);
        scene.sim.host().clear_fault();
        scene.sim.run_for(0.2);
        scene.cruise(0.4);
        scene.sim.run_for(1);
        CHECK(scene.fault() == Fault::none);
    }
}

// Learning makes some cycles long, and telemetry waits for these alone.
TEST(ChainLearning, adaptation_learns_and_telemetry_goes_on) {
    std::uint32_t told[2] = {};
    for (const Mode mode : {Mode::trajectory, Mode::adaptive}) {
        Scene scene(kShared, 45);
        protocol::TrajectoryCommand command;
        command.shape = protocol::TrajectoryShape::figure_eight;
        scene.sim.host().trajectory(command);
        CHECK(enter_mode(scene.sim, mode));
        scene.sim.run_for(2);
        const std::uint64_t before = scene.sim.bus().endpoint(0).statistics().frames_sent;
        scene.sim.run_for(6);
        told[mode == Mode::adaptive] =
            static_cast<std::uint32_t>(scene.sim.bus().endpoint(0).statistics().frames_sent - before);
        CHECK_EQUAL(mode == Mode::adaptive, scene.sim.cycle().learning().estimate().rows > 0);
    }
    CHECK(told[1] > 0.98 * told[0]);
}
