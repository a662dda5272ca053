// "Velocity loop through the whole chain (default latency and encoder), steps of 0.15 m/s and 0.7 rad/s, true
// speed judged: 1 % settling within 50 ms, overshoot under 0.5 % beyond quantisation, also with +-5 % model
// error; phase margin and Ms printed. With the paper's gains: ... through the chain the overshoot predicted
// for its real delay."
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(ChainVelocity){};

namespace {

struct Judged {
    double settling_s = 0;  // of the mean response
    double overshoot = 0;   // of the mean response: what remains when noise and quantisation average out
    double slowest_s = 0;   // of single responses
    double largest = 0;     // overshoot of single responses, noise and quantisation included
};

Judged judge(const std::vector<std::vector<double>>& responses, double wanted) {
    Judged j;
    std::vector<double> mean(responses.front().size());
    for (const auto& y : responses) {
        for (std::size_t i = 0; i < y.size(); ++i) {
            mean[i] += y[i] / wanted / static_cast<double>(responses.size());
            if (std::abs(y[i] / wanted - 1) > 0.01) j.slowest_s = std::max(j.slowest_s, 1e-3 * double(i + 1));
            j.largest = std::max(j.largest, y[i] / wanted - 1);
        }
    }
    for (std::size_t i = 0; i < mean.size(); ++i) {
        if (std::abs(mean[i] - 1) > 0.01) j.settling_s = 1e-3 * double(i + 1);
        j.overshoot = std::max(j.overshoot, mean[i] - 1);
    }
    return j;
}

}  // namespace

TEST(ChainVelocity, steps_settle_within_50_ms_without_overshoot_also_with_a_wrong_model) {
    const int seeds = chain::seeds(20, 100);
    for (const double model_error : {0.95, 1.0, 1.05}) {
        std::vector<std::vector<double>> v;
        std::vector<std::vector<double>> omega;
        for (int seed = 1; seed <= seeds; ++seed) {
            Simulation sim(chain::identified(model_error), chain::real().parameters,
                           chain::options(static_cast<std::uint64_t>(seed)));
            sim.run_for(0.5);
            const auto& design = sim.cycle().control().design();
            CHECK(design.accepted());
            if (seed == 1) {
                std::printf("model %+.0f %%: phase margin %.1f deg, Ms %.2f\n", 100 * (model_error - 1),
                            design.result().phase_margin_deg, design.result().sensitivity_peak);
                CHECK(design.result().phase_margin_deg >= 45);
                CHECK(design.result().sensitivity_peak <= 2);
            }
            v.push_back(velocity_step(sim, {0.15, 0}, 0.25).v_m_per_s);
            omega.push_back(velocity_step(sim, {0, 0.7}, 0.25).omega_rad_per_s);
            CHECK(!v.back().empty() && !omega.back().empty());
        }
        const Judged forward = judge(v, 0.15);
        const Judged yaw = judge(omega, 0.7);
        const auto show = [seeds](const char* name, const Judged& j) {
            std::printf(
                "  %-8s settles in %.0f ms (slowest of %d: %.0f ms); overshoot %.2f %% in the mean, with "
                "noise at most "
                "%.2f %%\n",
                name, 1e3 * j.settling_s, seeds, 1e3 * j.slowest_s, 100 * j.overshoot, 100 * j.largest);
        };
        show("speed", forward);
        show("yaw rate", yaw);
        for (const Judged& j : {forward, yaw}) {
            CHECK(j.settling_s <= 0.05);
            CHECK(j.slowest_s <= 0.05);
            CHECK(j.overshoot < 0.005);
        }
    }
}

// The centre of gravity 0.08 of the track beside the middle, and a left drive that gives a tenth less: the
// identification finds both, and with them the loops keep their settling time. Without, each axis disturbs
// the other.
TEST(ChainVelocity, steps_settle_with_a_centre_of_gravity_beside_the_middle_and_a_weak_drive) {
    model::RobotParameters real = chain::real().parameters;
    const std::size_t offset = model::find_effect("cog_lateral");
    const std::size_t gains = model::find_effect("torque_gain_mismatch");
    const double offset_m = 0.08 * real.geometry.track_m;
    real.effects.active[offset] = real.effects.active[gains] = true;
    real.effects.parameter[offset] = {offset_m};
    real.effects.parameter[gains] = {0.1};
    Simulation sim(chain::believed().parameters, real, chain::options(3));
    sim.run_for(0.5);
    CHECK(identify(sim).succeeded);
    const model::RobotParameters& found = sim.parameters();
    std::printf("found: %.2f mm of %.2f, gains %.4f of 0.1, K7 %.5f of %.5f, K8 %.5f of %.5f\n",
                1e3 * found.effects.parameter[offset][0], 1e3 * offset_m, found.effects.parameter[gains][0],
                found.dynamics.k7_per_kg_m, chain::truth().k7_per_kg_m, found.dynamics.k8_per_kg_m2,
                chain::truth().k8_per_kg_m2);
    CHECK(found.effects.active[offset] && found.effects.active[gains]);
    DOUBLES_EQUAL(offset_m, found.effects.parameter[offset][0], 0.1 * offset_m);
    // Radii that differ by 0.25 % look like gains that do, and this robot is near the one whose two causes do
    // the same (K8 b / 2 K7 = 0.87 where that one has 1): they come apart less well than their sum.
    DOUBLES_EQUAL(0.1, found.effects.parameter[gains][0], 0.02);
    DOUBLES_EQUAL(1, found.dynamics.k7_per_kg_m / chain::truth().k7_per_kg_m, 0.01);
    DOUBLES_EQUAL(1, found.dynamics.k8_per_kg_m2 / chain::truth().k8_per_kg_m2, 0.01);
    constexpr double aim_s = 0.05;
    for (const Twist<double> step : {Twist<double>{0.15, 0}, Twist<double>{0, 0.7}}) {
        const StepResponse response = velocity_step(sim, step, 0.25);
        const bool forward = step.v_m_per_s != 0;
        const std::vector<double>& y = forward ? response.v_m_per_s : response.omega_rad_per_s;
        double settling_s = HUGE_VAL;
        for (std::size_t i = 0; i < y.size(); ++i)
            if (std::abs(y[i] / (forward ? 0.15 : 0.7) - 1) > 0.015) settling_s = response.time_s[i];
        std::printf("%s settles to 1.5 %% in %.0f ms (designed %.0f)\n", forward ? "speed" : "yaw rate",
                    1e3 * settling_s, 1e3 * aim_s);
        CHECK(settling_s <= aim_s);
    }
}

namespace {

// More slowly, but not much more slowly than half of the torque holds: a third of what is asked at least.
void check_same_curve(const Twist<double>& asked, const Twist<double>& got) {
    const double share = got.v_m_per_s / asked.v_m_per_s;
    CHECK(share > 0.33 && share < 1);
    DOUBLES_EQUAL(share, got.omega_rad_per_s / asked.omega_rad_per_s, 0.02);
}

}  // namespace

// A robot that backs up, its centre of gravity far ahead of the axle, turns ever faster by itself; one that
// drives on is hard to turn. No torque of its wheels holds what the limits of speed and yaw rate allow: it
// would spin, or leave the curve at full speed.
TEST(ChainVelocity, a_robot_that_backs_up_before_its_centre_of_gravity_turns_no_faster_than_it_is_asked_to) {
    model::RobotParameters real = chain::real().parameters;
    model::Dynamics<double>& k = real.dynamics;
    k.k5_m = 0.09;
    k.k6_per_m = model::coupled_k6(k.k5_m, k.k7_per_kg_m, k.k8_per_kg_m2, real.geometry.track_m);
    model::RobotParameters known = chain::identified();
    known.dynamics = tools::as_seen_with(k, real.geometry, known.geometry);
    known.limits.torque_Nm = 1.6;
    for (const double way : {-1.0, 1.0}) {
        for (const double turn : {-1.0, 1.0}) {
            Simulation sim(known, real, chain::options(5));
            const Twist<double> asked{way * 2.1, turn * 4.7};
            sim.run_for(0.5);
            sim.host().velocity({asked.v_m_per_s, 0});
            CHECK(enter_mode(sim, protocol::Mode::velocity));
            sim.run_for(1);
            sim.host().velocity(asked);
            double fastest_rad_per_s = 0;
            bool limited = false;
            for (int i = 0; i < 2000; ++i) {
                sim.run_for(1e-3);
                fastest_rad_per_s =
                    std::max(fastest_rad_per_s, std::abs(sim.world().twist().omega_rad_per_s));
                limited = limited || sim.cycle().report().status.limit_yaw_rate;
            }
            const Twist<double>& got = sim.world().twist();
            std::printf("asked %+.1f m/s, %+.1f rad/s: %+.2f, %+.2f, at most %.2f; limited: %d\n",
                        asked.v_m_per_s, asked.omega_rad_per_s, got.v_m_per_s, got.omega_rad_per_s,
                        fastest_rad_per_s, int(limited));
            CHECK(sim.cycle().supervisor().mode() == protocol::Mode::velocity);
            CHECK(fastest_rad_per_s < 1.02 * std::abs(asked.omega_rad_per_s));
            CHECK(limited);
            check_same_curve(asked, got);
        }
    }
}

namespace {

struct RealAndKnown {
    model::RobotParameters real, known;
};

// A robot without friction, its centre of gravity ahead of the axle by K5, that is known as it is.
RealAndKnown without_friction(double k5_m, double torque_limit_Nm) {
    RealAndKnown robot{chain::real().parameters, chain::identified()};
    model::Dynamics<double>& k = robot.real.dynamics;
    k.k5_m = k5_m;
    k.k6_per_m = model::coupled_k6(k5_m, k.k7_per_kg_m, k.k8_per_kg_m2, robot.real.geometry.track_m);
    robot.known.dynamics = tools::as_seen_with(k, robot.real.geometry, robot.known.geometry);
    robot.real.effects = robot.known.effects = {};
    robot.known.limits.torque_Nm = torque_limit_Nm;
    return robot;
}

}  // namespace

// Such a robot, short of torque, while it turns and gains speed backwards: what keeps the turn from
// growing comes before what accelerates.
TEST(ChainVelocity, a_robot_that_backs_up_ever_faster_turns_no_faster_than_it_is_asked_to) {
    const auto [real, known] = without_friction(0.13, 0.5);
    for (const double turn : {-1.0, 1.0}) {
        Simulation sim(known, real, chain::options(5));
        sim.run_for(0.5);
        sim.host().velocity({-0.3, turn * 2.0});
        CHECK(enter_mode(sim, protocol::Mode::velocity));
        sim.run_for(4);
        sim.host().velocity({-1.6, turn * 2.0});
        double fastest_rad_per_s = 0;
        for (int i = 0; i < 6000; ++i) {
            sim.run_for(1e-3);
            fastest_rad_per_s = std::max(fastest_rad_per_s, std::abs(sim.world().twist().omega_rad_per_s));
        }
        const Twist<double>& last = sim.world().twist();
        std::printf("asked -1.6 m/s, %+.1f rad/s: %+.2f, %+.2f, at most %.2f\n", turn * 2.0, last.v_m_per_s,
                    last.omega_rad_per_s, fastest_rad_per_s);
        CHECK(sim.cycle().supervisor().mode() == protocol::Mode::velocity);
        CHECK(fastest_rad_per_s < 1.05 * 2.0);
        check_same_curve({-1.6, turn * 2.0}, last);
    }
}

// A robot that turns is pushed towards its centre of gravity, here far ahead of the axle or behind it, and
// one that moves that way straightens by itself. Little torque is left, and no friction brakes: with seven
// tenths of the torque for turning first, this one went on at 0.8 m/s, asked for 0.3.
TEST(ChainVelocity, a_robot_that_turns_far_from_its_centre_of_gravity_slows_down_when_asked_to) {
    for (const double way : {-1.0, 1.0}) {
        const auto [real, known] = without_friction(way * 0.13, 0.8);
        for (const double turn : {-1.0, 1.0}) {
            Simulation sim(known, real, chain::options(5));
            sim.run_for(0.5);
            sim.host().velocity({way * 1.2, turn * 0.5});
            CHECK(enter_mode(sim, protocol::Mode::velocity));
            sim.run_for(6);
            const Twist<double> asked{way * 0.3, turn * 4.2};
            sim.host().velocity(asked);
            double fastest_m_per_s = 0, fastest_rad_per_s = 0;
            for (int i = 0; i < 8000; ++i) {
                sim.run_for(1e-3);
                const Twist<double>& twist = sim.world().twist();
                fastest_m_per_s = std::max(fastest_m_per_s, std::abs(twist.v_m_per_s));
                fastest_rad_per_s = std::max(fastest_rad_per_s, std::abs(twist.omega_rad_per_s));
            }
            const Twist<double>& last = sim.world().twist();
            std::printf("asked %+.1f m/s, %+.1f rad/s: %+.2f, %+.2f, at most %.2f, %.2f\n", asked.v_m_per_s,
                        asked.omega_rad_per_s, last.v_m_per_s, last.omega_rad_per_s, fastest_m_per_s,
                        fastest_rad_per_s);
            CHECK(sim.cycle().supervisor().mode() == protocol::Mode::velocity);
            CHECK(fastest_m_per_s < 1.22);
            check_same_curve(asked, last);
            CHECK(fastest_rad_per_s < std::abs(asked.omega_rad_per_s));
        }
    }
}

// What the torque limit does not let come pushes nothing sideways. The reference runs away from a robot whose
// torque is short; the push that the wanted deceleration would make, were there the torque for it, is many
// times what the wheels can do. So is the difference of two drives' gains of such a torque.
TEST(ChainVelocity, a_lopsided_robot_with_little_torque_turns_no_faster_than_it_is_asked_to) {
    struct Lopsided {
        const char* effect;
        double parameter;
    };
    const double track_m = chain::real().parameters.geometry.track_m;
    for (const Lopsided& lopsided :
         {Lopsided{"cog_lateral", 0.08 * track_m}, Lopsided{"cog_lateral", -0.08 * track_m},
          Lopsided{"torque_gain_mismatch", 0.12}, Lopsided{"torque_gain_mismatch", -0.12}}) {
        const std::size_t effect = model::find_effect(lopsided.effect);
        model::RobotParameters real = chain::real().parameters;
        real.effects.active[effect] = true;
        real.effects.parameter[effect] = {lopsided.parameter};
        model::RobotParameters known = chain::identified();
        known.effects.active[effect] = true;
        known.effects.parameter[effect] = {0.95 * lopsided.parameter};
        known.limits.torque_Nm = 1.0;  // about 1 m/s^2, where the reference changes by several
        for (const double way : {-1.0, 1.0}) {
            for (const Twist<double> then : {Twist<double>{}, Twist<double>{-1.2, 2.0}}) {
                Simulation sim(known, real, chain::options(7));
                sim.run_for(0.5);
                sim.host().velocity({way * 1.2, 0.4});
                CHECK(enter_mode(sim, protocol::Mode::velocity));
                sim.run_for(4);
                DOUBLES_EQUAL(way * 1.2, sim.world().twist().v_m_per_s, 0.03);
                sim.host().velocity({way * then.v_m_per_s, then.omega_rad_per_s});
                double fastest_rad_per_s = 0, backwards_rad_per_s = 0;
                for (int i = 0; i < 5000; ++i) {
                    sim.run_for(1e-3);
                    const double omega = sim.world().twist().omega_rad_per_s;
                    fastest_rad_per_s = std::max(fastest_rad_per_s, omega);
                    backwards_rad_per_s = std::min(backwards_rad_per_s, omega);
                }
                std::printf("%s %+.2f, %+.1f m/s, then %+.1f, %.1f: turns by %.2f to %.2f rad/s\n",
                            lopsided.effect, lopsided.parameter, way * 1.2, way * then.v_m_per_s,
                            then.omega_rad_per_s, backwards_rad_per_s, fastest_rad_per_s);
                CHECK(sim.cycle().supervisor().mode() == protocol::Mode::velocity);
                CHECK(fastest_rad_per_s < 1.05 * std::max(0.4, then.omega_rad_per_s));
                CHECK(backwards_rad_per_s > -0.03);
            }
        }
    }
}

// From rest to a circle and from a circle to rest, with more acceleration asked for than the torque gives:
// the reference waits for the robot, which therefore stays on the circle. (Before it did, the robot left this
// one of 0.8 m radius by 0.5 m, and by 20 mm when it stopped.)
TEST(ChainVelocity, a_robot_with_little_torque_keeps_to_its_circle) {
    model::RobotParameters known = chain::identified();
    known.limits.torque_Nm = 1.0;
    for (const double way : {-1.0, 1.0}) {
        for (const bool stops : {false, true}) {
            Simulation sim(known, chain::real().parameters, chain::options(7));
            sim.run_for(0.5);
            const Twist<double> circle{way * 1.2, 1.5};
            const Twist<double> rest;
            sim.host().velocity(stops ? circle : rest);
            CHECK(enter_mode(sim, protocol::Mode::velocity));
            sim.run_for(stops ? 6 : 1);
            const Pose<double> start = sim.world().plant().pose();
            const Twist<double> first = stops ? sim.world().twist() : circle;
            const double radius_m = first.v_m_per_s / first.omega_rad_per_s;
            const double centre_x_m = start.x_m - radius_m * std::sin(start.heading_rad);
            const double centre_y_m = start.y_m + radius_m * std::cos(start.heading_rad);
            sim.host().velocity(stops ? rest : circle);
            double off_m = 0, settled_s = 0;
            for (int i = 0; i < 3000; ++i) {
                sim.run_for(1e-3);
                const Pose<double> at = sim.world().plant().pose();
                off_m = std::max(off_m, std::abs(std::hypot(at.x_m - centre_x_m, at.y_m - centre_y_m) -
                                                 std::abs(radius_m)));
                const double goal_m_per_s = stops ? 0 : circle.v_m_per_s;
                if (std::abs(sim.world().twist().v_m_per_s - goal_m_per_s) > 0.03) settled_s = 1e-3 * i;
            }
            std::printf("%s a circle at %+.1f m/s: %.1f mm off it, after %.2f s\n", stops ? "from" : "to",
                        circle.v_m_per_s, 1e3 * off_m, settled_s);
            CHECK(off_m < (stops ? 0.004 : 0.1) * std::abs(radius_m));
            CHECK(settled_s < (stops ? 0.45 : 1.15));  // as soon as before
        }
    }
}

// Eq (69)-(72). Note 6: sampled at 1 kHz with a hold, 1 / 2 / 3 ms of delay give 17.7 / 24.7 / 42.9 %. The
// chain's delay lies between 1 and 2 ms, and the observer adds its own.
TEST(ChainVelocity, the_papers_gains_overshoot_as_their_delay_predicts) {
    model::RobotParameters p = chain::identified();
    p.velocity_loop.method = model::LoopDesignMethod::paper;
    p.velocity_loop.phase_margin_deg = 20;
    p.velocity_loop.sensitivity_peak = 4;
    std::vector<std::vector<double>> v;
    for (int seed = 1; seed <= 20; ++seed) {
        Simulation sim(p, chain::real().parameters, chain::options(static_cast<std::uint64_t>(seed)));
        sim.run_for(0.5);
        // 0.04 m/s: far from the torque limit
        v.push_back(velocity_step(sim, {0.04, 0}, 0.25).v_m_per_s);
    }
    const Judged paper = judge(v, 0.04);
    std::printf("the paper's gains through the chain: overshoot %.1f %%, settles in %.0f ms\n",
                100 * paper.overshoot, 1e3 * paper.settling_s);
    CHECK(paper.overshoot > 0.177);
    CHECK(paper.overshoot < 0.26);
}
