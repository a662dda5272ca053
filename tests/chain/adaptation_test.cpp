// "+30 % mass and inertia dropped on during that figure-8: K7, K8 within 5 % of the new values 3 s later in
// 19 of 20 seeds ...; parked for ten minutes, nothing drifts and P stays bounded; a constant-speed circle
// freezes what it does not excite."
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(ChainAdaptation){};

TEST(ChainAdaptation, a_payload_is_known_three_seconds_later_in_19_of_20_seeds) {
    int good = 0;
    double worst = 0;
    double worst_rms = 0;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        SimulationOptions options = chain::options(seed);
        options.world.start_pose = {0, 1, 0};
        Simulation sim(chain::identified(), chain::real().parameters, options);
        sim.run_for(0.5);
        TrackingOptions tracking;
        tracking.mode = protocol::Mode::adaptive;
        tracking.path = control::standard_figure_eight<double>(chain::believed().parameters);
        // Not always at the same place of the figure.
        const double when_s = 15 + 0.5 * static_cast<double>(seed);
        tracking.duration_s = when_s + 4;
        bool dropped = false;
        bool judged = false;
        tracking.event = [&](Simulation& now, double time_s) {
            if (!dropped && time_s >= when_s) {
                drop_payload(now.world(), 0.3);
                dropped = true;
            }
            if (judged || time_s < when_s + 3) return;
            judged = true;
            const auto real =
                as_seen_with(sim::plant_dynamics(now.world().plant().parameters()),
                             chain::real().parameters.geometry, chain::believed().parameters.geometry);
            const auto& found = now.cycle().learning().estimate().dynamics;
            const double error = std::max(std::abs(found.k7_per_kg_m / real.k7_per_kg_m - 1),
                                          std::abs(found.k8_per_kg_m2 / real.k8_per_kg_m2 - 1));
            worst = std::max(worst, error);
            if (error <= 0.05) ++good;
        };
        const TrackingResult result = track(sim, tracking);
        CHECK(result.entered);
        CHECK(judged);
        worst_rms = std::max(worst_rms, result.rms_m);
    }
    std::printf(
        "K7 and K8 within 5 %% 3 s after +30 %%: %d of 20 seeds, worst error %.2f %%; tracking at most %.2f "
        "mm RMS\n",
        good, 100 * worst, 1e3 * worst_rms);
    CHECK(good >= 19);
}

// An effect that the robot file names with 0 +- 0 is unknown, not known to be zero. Adaptation would take the
// friction for mass: measured without this rule, K7 went to a third within 30 s.
TEST(ChainAdaptation, beside_an_effect_that_nobody_has_measured_it_is_refused) {
    const auto entered = [](double value, double standard_error) {
        model::RobotParameters p = chain::identified();
        const std::size_t effect = model::find_effect("coulomb_friction");
        CHECK(p.effects.active[effect]);
        p.effects.parameter[effect][1] = value;
        p.effects_standard_error.parameter[effect][1] = standard_error;
        Simulation sim(p, chain::real().parameters, chain::options(7));
        sim.run_for(0.5);
        const bool yes = enter_mode(sim, protocol::Mode::adaptive);
        const auto status = sim.cycle().report().status;
        CHECK_EQUAL(yes, status.model_trusted);
        if (!yes) CHECK(status.blocker == protocol::Blocker::model_not_trusted);
        return yes;
    };
    CHECK_FALSE(entered(0, 0));
    CHECK(entered(0, 0.01));  // measured, and found to be nothing
    CHECK(entered(0.3, 0));   // given by hand
}

// Adaptive mode with a streamed reference that does not move: the robot is parked for ten minutes.
TEST(ChainAdaptation, parked_for_ten_minutes_nothing_drifts) {
    Simulation sim(chain::identified(), chain::real().parameters, chain::options(11));
    sim.run_for(0.5);
    sim.host().external_pose(sim.world().pose());
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::streamed;
    sim.host().trajectory(command);
    sim.host().stream([](double) { return std::pair<Pose<double>, Twist<double>>{{0, 0, 0}, {0, 0}}; });
    CHECK(enter_mode(sim, protocol::Mode::adaptive));
    sim.run_for(2);
    const auto before = sim.cycle().learning().estimate();
    const auto plant_before = sim.cycle().control().plant().dynamics;
    const double minutes = chain::seeds(10, 60);
    sim.run_for(60 * minutes);
    CHECK(sim.cycle().supervisor().mode() == protocol::Mode::adaptive);
    const auto after = sim.cycle().learning().estimate();
    const auto plant_after = sim.cycle().control().plant().dynamics;
    const auto& p = after.covariance_diagonal;
    std::printf("after %.0f minutes: K7 %+.4f %%, K8 %+.4f %%, P %.2g %.2g %.2g, moved %.2f mm\n", minutes,
                100 * (after.dynamics.k7_per_kg_m / before.dynamics.k7_per_kg_m - 1),
                100 * (after.dynamics.k8_per_kg_m2 / before.dynamics.k8_per_kg_m2 - 1), p.k5_m, p.k7_per_kg_m,
                p.k8_per_kg_m2, 1e3 * std::hypot(sim.world().pose().x_m, sim.world().pose().y_m));
    CHECK(std::abs(after.dynamics.k7_per_kg_m / before.dynamics.k7_per_kg_m - 1) < 0.001);
    CHECK(std::abs(after.dynamics.k8_per_kg_m2 / before.dynamics.k8_per_kg_m2 - 1) < 0.001);
    CHECK(std::abs(plant_after.k7_per_kg_m / plant_before.k7_per_kg_m - 1) < 0.001);
    CHECK(std::isfinite(p.k5_m) && p.k7_per_kg_m < 1 && p.k8_per_kg_m2 < 20);
    CHECK(std::hypot(sim.world().pose().x_m, sim.world().pose().y_m) < 0.01);
}

TEST(ChainAdaptation, a_constant_circle_freezes_what_it_does_not_excite) {
    Simulation sim(chain::identified(), chain::real().parameters, chain::options(5));
    sim.run_for(0.5);
    sim.host().external_pose(sim.world().pose());
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::circle;
    command.length_m = 2;
    command.period_s = 12;
    sim.host().trajectory(command);
    CHECK(enter_mode(sim, protocol::Mode::adaptive));
    sim.run_for(30);
    const auto before = sim.cycle().learning().estimate();
    const bool frozen = sim.cycle().learning().adaptation_frozen();
    sim.run_for(chain::seeds(120, 600));
    const auto after = sim.cycle().learning().estimate();
    std::printf("circle: K7 %+.3f %%, K8 %+.3f %%, frozen %d\n",
                100 * (after.dynamics.k7_per_kg_m / before.dynamics.k7_per_kg_m - 1),
                100 * (after.dynamics.k8_per_kg_m2 / before.dynamics.k8_per_kg_m2 - 1), int(frozen));
    CHECK(frozen);
    CHECK(std::abs(after.dynamics.k7_per_kg_m / before.dynamics.k7_per_kg_m - 1) < 0.01);
    CHECK(std::abs(after.dynamics.k8_per_kg_m2 / before.dynamics.k8_per_kg_m2 - 1) < 0.01);
    CHECK(sim.cycle().report().status.limit_adaptation_frozen);
}

// Note 18: a robot whose wheels say something else than an outside observer teaches nothing.
TEST(ChainAdaptation, slip_freezes_the_adaptation) {
    const auto frozen_share = [](double limit_rad_per_s) {
        model::RobotParameters p = chain::identified();
        p.adaptation.slip_yaw_rate_rad_per_s = limit_rad_per_s;
        Simulation sim(p, chain::real().parameters, chain::options(6));
        sim.run_for(0.5);
        TrackingOptions tracking;
        tracking.mode = protocol::Mode::adaptive;
        tracking.path = control::standard_figure_eight<double>(p);
        tracking.duration_s = 12;
        int frozen = 0;
        int cycles = 0;
        tracking.event = [&](Simulation& now, double time_s) {
            // A hand turns the robot at 1.2 rad/s for a second, and the wheels do not know.
            if (time_s > 10 && time_s < 11) {
                Pose<double> pose = now.world().pose();
                pose.heading_rad += 1.2e-3;
                now.world().plant().place(pose, now.world().twist());
            }
            if (time_s > 10.5 && time_s < 11.5) {
                ++cycles;
                if (now.cycle().report().status.limit_adaptation_frozen) ++frozen;
            }
        };
        track(sim, tracking);
        return static_cast<double>(frozen) / cycles;
    };
    const double watched = frozen_share(0.5);
    const double unwatched = frozen_share(20);
    std::printf(
        "adaptation frozen for %.0f %% of the time while the robot slips; without the watch %.0f %%\n",
        100 * watched, 100 * unwatched);
    CHECK(watched > 0.95);
    CHECK(unwatched < 0.5);
}
