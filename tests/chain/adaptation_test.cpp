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

namespace {

// At a constant pace, two metres across.
bool adapt_on_a_circle(Simulation& sim) {
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::circle;
    command.length_m = 2;
    command.period_s = 12;
    sim.host().trajectory(command);
    return enter_mode(sim, protocol::Mode::adaptive);
}

}  // namespace

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

TEST(ChainAdaptation, a_constant_circle_freezes_what_it_does_not_excite_but_for_the_dither) {
    model::RobotParameters calm = chain::identified();
    calm.adaptation.dither_error = 0;
    Simulation sim(calm, chain::real().parameters, chain::options(5));
    sim.run_for(0.5);
    sim.host().external_pose(sim.world().pose());
    CHECK(adapt_on_a_circle(sim));
    sim.run_for(30);
    const auto before = sim.cycle().learning().estimate();
    const bool frozen = sim.cycle().learning().adaptation_frozen();
    sim.run_for(chain::seeds(120, 600));
    const auto after = sim.cycle().learning().estimate();
    const double k7 = after.dynamics.k7_per_kg_m / before.dynamics.k7_per_kg_m - 1;
    const double k8 = after.dynamics.k8_per_kg_m2 / before.dynamics.k8_per_kg_m2 - 1;
    const double error7 = after.standard_error.k7_per_kg_m / after.dynamics.k7_per_kg_m;
    const double error8 = after.standard_error.k8_per_kg_m2 / after.dynamics.k8_per_kg_m2;
    std::printf("circle: K7 %+.3f +- %.3f %%, K8 %+.3f +- %.3f %%, frozen %d\n", 100 * k7, 100 * error7,
                100 * k8, 100 * error8, int(frozen));
    CHECK(frozen);
    // No more than they say themselves, nor than half of the 5 % with which ChainVelocity settles.
    constexpr double kHalf = 0.025;
    CHECK(std::abs(k7) < std::min(error7, kHalf));
    CHECK(std::abs(k8) < std::min(error8, kHalf));
    CHECK(sim.cycle().report().status.limit_adaptation_frozen);
}

// On a circle at a constant pace nothing but the dither tells mass and inertia. How far it moves the robot is
// read from the body: less than its share of the track at both rims, and the way of the circle's own errors.
TEST(ChainAdaptation, on_a_constant_circle_the_dither_tells_a_load) {
    for (const bool dither : {true, false}) {
        model::RobotParameters p = chain::identified();
        if (!dither) p.adaptation.dither_error = 0;
        Simulation sim(p, chain::real().parameters, chain::options(5));
        sim.run_for(0.5);
        CHECK(adapt_on_a_circle(sim));
        sim.run_for(15);
        sim::PlantParameters loaded = sim.world().plant().parameters();
        loaded.mass_kg *= 1.2;
        loaded.inertia_kg_m2 *= 1.2;
        sim.world().plant().set_parameters(loaded);
        sim.run_for(5);
        const auto k = sim.cycle().learning().estimate().dynamics;
        const double off7 = 1.2 * k.k7_per_kg_m / chain::truth().k7_per_kg_m - 1;
        const double off8 = 1.2 * k.k8_per_kg_m2 / chain::truth().k8_per_kg_m2 - 1;
        double fastest = 0, slowest = HUGE_VAL;
        for (int i = 0; i < 3000; ++i) {
            sim.run_for(0.001);
            const double v = sim.world().plant().twist().v_m_per_s;
            fastest = std::max(fastest, v);
            slowest = std::min(slowest, v);
        }
        std::printf(
            "circle %s dither, 20 %% more mass and inertia: K7 %+.2f %%, K8 %+.2f %% off 5 s later; speed "
            "within %.2f mm/s\n",
            dither ? "with" : "without", 100 * off7, 100 * off8, 500 * (fastest - slowest));
        if (!dither) continue;
        CHECK(std::abs(off7) < 0.05 && std::abs(off8) < 0.05);
        CHECK(!sim.cycle().learning().adaptation_frozen());
        CHECK(fastest - slowest < 0.02);
    }
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
