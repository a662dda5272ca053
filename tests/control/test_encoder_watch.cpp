#include "firmware/control/encoder_watch.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "tests/control/inner_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

constexpr double kFriction_Nm = 0.3;
constexpr double kLimit_Nm = 4;
constexpr double kUnseen_rad = 1.5 * 2 * bench::kPi / 64;

model::RobotParameters parameters() {
    auto p = bench::notes_robot();
    bench::set_coulomb(p, 1.03 * kFriction_Nm, 1.03 * kFriction_Nm);
    p.limits.torque_Nm = kLimit_Nm;
    return p;
}

bench::Truth truth() {
    bench::Truth t;
    t.transport_s = parameters().velocity_loop.actuation_delay_s - t.lag_s;
    t.coulomb_left_Nm = t.coulomb_right_Nm = kFriction_Nm;
    return t;
}

// Observer and watch of a robot whose encoders may be made to lie.
struct Watched {
    PlantModel<double> model = plant_model<double>(parameters());
    WheelObserver<double> observer;
    EncoderWatch watch;
    bench::Robot robot;
    bool known = true;
    bool no_count = false;  // comes: behind a drive's loop that tells nothing of an angle
    std::function<WheelPair<double>(const WheelPair<double>&)> tell;  // what is told of the true angles

    explicit Watched(const bench::Truth& of = truth()) : robot(of, 7) {
        observer.configure(wheel_observer_settings<double>(parameters(), 1e-3));
        watch.configure(encoder_watch_settings(parameters(), false));
        drive({}, 100);
        watch.rest(bench::told_angles({robot.left.position_rad, robot.right.position_rad}, {}));
    }

    static void make_unsure(auto& angles) {
        for (auto& angle : angles) angle.unsure_rad = std::numeric_limits<double>::infinity();
    }

    // The cycle in which the watch does not believe an encoder; -1: none.
    int drive(const WheelPair<double>& torque_Nm, int cycles) {
        for (int k = 0; k < cycles; ++k) {
            observer.torque_sent(torque_Nm);
            robot.cycle(torque_Nm.left, torque_Nm.right);
            WheelPair<double> told{robot.left.position_rad, robot.right.position_rad};
            if (tell) told = tell(told);
            observer.update(robot.now_ns(), {told.left, 0, robot.left.time_ns},
                            {told.right, 0, robot.right.time_ns}, model);
            auto angles = bench::told_angles(told, {robot.left.time_ns, robot.right.time_ns});
            if (no_count) make_unsure(angles);
            if (watch.update(1e-3, angles, observer, torque_Nm, model, known)) return k;
            watch.look(observer.motion().wheel_speed_rad_per_s, model);
        }
        return -1;
    }

    // From now on one wheel's encoder tells this share of its wheel's way.
    void lies(bool right, double share) {
        const double from = right ? robot.right.position_rad : robot.left.position_rad;
        tell = [right, share, from](WheelPair<double> told) {
            double& angle = right ? told.right : told.left;
            angle = from + share * (angle - from);
            return told;
        };
    }
    void swap() {
        const double apart = robot.right.position_rad - robot.left.position_rad;
        tell = [apart](const WheelPair<double>& told) {
            return WheelPair<double>{told.right - apart, told.left + apart};
        };
    }
};

WheelPair<double> pushes(double torque_Nm, bool turning) {
    return {turning ? -torque_Nm : torque_Nm, torque_Nm};
}

}  // namespace

TEST_GROUP(EncoderWatch){};

TEST(EncoderWatch, believes_encoders_that_tell_the_truth) {
    Watched w;
    bench::Noise random(3);
    for (int bit = 0; bit < 200; ++bit) {
        const double torque_Nm = kLimit_Nm * random.uniform() * (bit % 2 == 0 ? 1 : -1);
        LONGS_EQUAL(-1, w.drive(pushes(torque_Nm, random.uniform() < 0.5), 60));
        LONGS_EQUAL(-1, w.drive({}, 100));
    }
}

TEST(EncoderWatch, friction_holds_a_wheel_whose_encoder_is_no_liar) {
    Watched w;
    for (int i = 0; i < 10; ++i) LONGS_EQUAL(-1, w.drive(pushes(0.9 * kFriction_Nm, i % 2 == 0), 500));
}

// Behind a drive's loop no count may have come when the watch begins.
TEST(EncoderWatch, a_rest_that_tells_no_angle_hides_no_motion) {
    Watched w;
    auto told = bench::told_angles({w.robot.left.position_rad, w.robot.right.position_rad}, {});
    Watched::make_unsure(told);
    w.watch.rest(told);
    w.no_count = true;
    LONGS_EQUAL(-1, w.drive({}, 20));
    w.no_count = false;
    LONGS_EQUAL(-1, w.drive(pushes(2, false), 300));
}

TEST(EncoderWatch, an_encoder_that_stands_still_is_seen_at_speed_and_from_rest) {
    for (const bool right : {false, true}) {
        for (const int before : {0, 150}) {
            Watched w;
            w.drive(pushes(2, false), before);
            w.lies(right, 0);
            const int seen = w.drive(pushes(2, false), 500);
            const int bound = before > 0 ? 100 : 120;  // from rest it is no lie at first
            CHECK_TEXT(seen > 0 && seen <= bound, std::to_string(seen).c_str());
        }
    }
}

TEST(EncoderWatch, an_encoder_that_turns_round_at_speed_is_seen) {
    for (const bool right : {false, true}) {
        Watched w;
        w.drive(pushes(2, false), 300);
        w.drive(pushes(kFriction_Nm, false), 100);
        LONGS_EQUAL(-1, w.drive(pushes(kFriction_Nm, false), 100));
        w.lies(right, -1);
        const int seen = w.drive(pushes(kFriction_Nm, false), 500);
        CHECK_TEXT(seen > 0 && seen <= 100, std::to_string(seen).c_str());
    }
}

// A light robot's loop has doubled a wheel's speed some tenths of a second after its encoder loses each other
// count.
TEST(EncoderWatch, an_encoder_that_loses_counts_at_speed_is_seen) {
    for (const double share : {0.5, 0.25}) {
        for (const bool right : {false, true}) {
            Watched w;
            w.drive(pushes(2, false), 300);
            LONGS_EQUAL(-1, w.drive(pushes(kFriction_Nm, false), 200));
            w.lies(right, share);
            const int seen = w.drive(pushes(2, false), 500);
            CHECK_TEXT(seen > 0 && seen <= 200, std::to_string(seen).c_str());
        }
    }
}

TEST(EncoderWatch, full_torque_from_rest_shows_a_wrong_way) {
    for (const bool right : {false, true}) {
        Watched w;
        w.lies(right, -1);
        const int seen = w.drive(pushes(kLimit_Nm, false), 500);
        CHECK_TEXT(seen > 0 && seen <= 130, std::to_string(seen).c_str());
    }
}

TEST(EncoderWatch, exchanged_encoders_show_at_speed) {
    Watched w;
    w.drive(pushes(2, true), 200);
    w.drive(pushes(kFriction_Nm, true), 100);
    w.swap();
    const int seen = w.drive(pushes(kFriction_Nm, true), 500);
    CHECK_TEXT(seen > 0 && seen <= 100, std::to_string(seen).c_str());
}

TEST(EncoderWatch, a_robot_that_a_wall_stops_or_throws_back_is_no_liar) {
    for (const double left_of_it : {0.0, -0.3, 0.5}) {
        for (const bool turning : {false, true}) {
            Watched w;
            w.drive(pushes(3, turning), turning ? 60 : 300);
            LONGS_EQUAL(-1, w.drive(pushes(kFriction_Nm, turning), 200));
            const double v = w.robot.v, omega = w.robot.omega;
            for (int ms = 1; ms <= 10; ++ms) {
                const double share = 1 + (left_of_it - 1) * ms / 10;
                w.robot.v = share * v;
                w.robot.omega = share * omega;
                w.drive(pushes(kFriction_Nm, turning), 1);
            }
            const std::string text = std::to_string(left_of_it) + (turning ? ", turning" : "");
            LONGS_EQUAL_TEXT(-1, w.drive(pushes(kFriction_Nm, turning), 300), text.c_str());
        }
    }
}

// No digit changes where it stands.
TEST(EncoderWatch, without_noise_a_wheel_may_stand_as_well) {
    bench::Truth quiet = truth();
    quiet.encoder_noise_rad = 0;
    Watched w(quiet);
    for (const double share : {0.9, -0.9, 0.0})
        LONGS_EQUAL(-1, w.drive(pushes(share * kFriction_Nm, false), 500));
    w.drive(pushes(2, false), 200);
    w.drive(pushes(-2, false), 100);
    LONGS_EQUAL(-1, w.drive({}, 1500));
    DOUBLES_EQUAL(0, w.robot.v, 1e-6);
}

TEST(EncoderWatch, a_still_encoder_of_an_unknown_robot_is_seen_after_80_ms_of_what_nothing_holds) {
    for (const bool right : {false, true}) {
        Watched w;
        w.known = false;
        LONGS_EQUAL(-1, w.drive(pushes(kLimit_Nm, false), 300));
        LONGS_EQUAL(-1, w.drive(pushes(-kLimit_Nm, false), 300));
        w.lies(right, 0);
        LONGS_EQUAL(-1,
                    w.drive(pushes(0.8, false), 300));  // half more than its friction, and a tenth of 4 Nm
        LONGS_EQUAL(-1, w.drive(pushes(kLimit_Nm, false), 60));
        LONGS_EQUAL(-1, w.drive(pushes(0.8, false), 20));  // counts anew
        const int seen = w.drive(pushes(kLimit_Nm, false), 300);
        CHECK_TEXT(seen >= 75 && seen <= 85, std::to_string(seen).c_str());
    }
}

// An identification pushes gently, on level floor.
TEST(EncoderWatch, an_identifications_pushes_show_a_wrong_way_and_exchanged_encoders) {
    for (const int lie : {0, 1, 2}) {  // left, right, exchanged
        for (const bool identifying : {false, true}) {
            Watched w;
            w.watch.configure(encoder_watch_settings(parameters(), identifying));
            LONGS_EQUAL(-1, w.drive(pushes(0.2 * kLimit_Nm, lie == 2), 200));
            LONGS_EQUAL(-1, w.drive(pushes(-0.2 * kLimit_Nm, lie == 2), 200));
            w.drive({}, 200);
            if (lie == 2) {
                w.swap();
            } else {
                w.lies(lie == 1, -1);
            }
            const int seen = w.drive(pushes(0.2 * kLimit_Nm, lie == 2), 150);
            CHECK_TEXT(identifying ? seen > 0 && seen <= 130 : seen == -1, std::to_string(seen).c_str());
        }
    }
}

// Nor does a push say anything where friction is not known.
// On a level floor, from rest and in motion, until the wheel has turned as far as the coarsest encoder hides,
// and 100 ms. Friction may be a third more or less than what is known: then no encoder that tells the truth
// lies.
TEST(EncoderWatch, an_identifications_pushes_show_a_still_encoder_at_any_moment) {
    model::RobotParameters p = parameters();
    p.velocity_loop.angle_noise_rad = 2e-4;
    bench::Noise random(11);
    int longest = 0;
    for (int run = 0; run < 120; ++run) {
        bench::Truth t = truth();
        const double friction_Nm = kFriction_Nm * (run % 3 == 0 ? 1.0 : run % 3 == 1 ? 1.35 : 0.74);
        t.coulomb_left_Nm = t.coulomb_right_Nm = friction_Nm;
        Watched w(t);
        w.watch.configure(encoder_watch_settings(p, true));
        const bool right = run % 2 == 0;
        bool lies = false;
        double told_rad = 0;
        int hidden_cycles = -1;
        for (int push = 0; push < 40 && hidden_cycles < 0; ++push) {
            const double share = (0.1 + 0.5 * random.uniform()) * (push / 2 % 2 == 0 ? 1 : -1);
            const int cycles = 20 + static_cast<int>(80 * random.uniform());
            const int freezes = push == 20 + run % 5 ? cycles / 2 : -1;
            for (int i = 0; i < 2 * cycles; ++i) {
                const double angle_rad = right ? w.robot.right.position_rad : w.robot.left.position_rad;
                if (i == freezes) {
                    w.lies(right, 0);
                    told_rad = angle_rad;
                    lies = true;
                }
                const bool too_far = lies && std::abs(angle_rad - told_rad) > kUnseen_rad;
                if (hidden_cycles >= 0 || too_far) ++hidden_cycles;
                const int seen =
                    w.drive(i < cycles ? pushes(share * kLimit_Nm, push % 4 == 3) : WheelPair<double>{}, 1);
                const std::string text = std::to_string(run) + " " + std::to_string(push);
                if (!lies) LONGS_EQUAL_TEXT(-1, seen, text.c_str());
                if (seen >= 0) {
                    longest = std::max(longest, hidden_cycles);
                    hidden_cycles = 0;
                    break;
                }
                CHECK_TEXT(hidden_cycles <= 100, text.c_str());
            }
        }
        CHECK_TEXT(hidden_cycles >= 0, std::to_string(run).c_str());
    }
    std::printf("  still encoders in an identification: seen %d ms after they hide a wheel's way\n", longest);
}

TEST(EncoderWatch, a_body_that_turns_and_an_unknown_friction_are_no_wrong_way) {
    bench::Truth ahead = truth();
    ahead.k5 = 0.16;
    model::RobotParameters p = parameters();
    p.dynamics.k5_m = ahead.k5;
    p.dynamics.k6_per_m = ahead.k6();
    Watched turning(ahead);
    turning.model = plant_model<double>(p);
    turning.observer.configure(wheel_observer_settings<double>(p, 1e-3));
    turning.watch.configure(encoder_watch_settings(p, true));
    for (const double way : {1.0, -1.0}) {
        LONGS_EQUAL(-1, turning.drive(pushes(0.3 * way * kLimit_Nm, true), 400));
        CHECK_TEXT(std::abs(turning.robot.omega) > 4, std::to_string(turning.robot.omega).c_str());
        LONGS_EQUAL(-1, turning.drive(pushes(-0.125 * kLimit_Nm, false), 200));
        LONGS_EQUAL(-1, turning.drive({}, 1500));
    }
    bench::set_coulomb(p, 0, 0);
    Watched unknown;
    unknown.watch.configure(encoder_watch_settings(p, true));
    unknown.lies(true, -1);
    LONGS_EQUAL(-1, unknown.drive(pushes(0.2 * kLimit_Nm, false), 150));
}

TEST(EncoderWatch, its_settings_follow_from_the_robot) {
    struct Row {
        double friction_left_Nm, friction_right_Nm, bandwidth;
        double held_Nm, known_Nm;
        int span;
    };
    // 4 Nm, mean radius 0.08 m
    const Row rows[] = {
        {0.3, 0.2, 100, 0.45, 0.375, 10}, {0.2, 0.3, 69, 0.45, 0.375, 14}, {0, 0, 40, 2, 0, 20},
        {1.5, 0.2, 500, 2.25, 1.875, 6},  {0.3, 0.2, 160, 0.45, 0.375, 6}, {0.3, 0.2, 150, 0.45, 0.375, 7},
    };
    for (const Row& row : rows) {
        model::RobotParameters p = parameters();
        p.geometry = {{0.06, 0.1}, 0.4};
        p.safety.clear_speed_m_per_s = 0.05;
        p.velocity_loop.observer_bandwidth_rad_per_s = row.bandwidth;
        bench::set_coulomb(p, row.friction_left_Nm, row.friction_right_Nm);
        for (const bool identifying : {false, true}) {
            const EncoderWatchSettings to = encoder_watch_settings(p, identifying);
            const int span = identifying ? 15 : row.span;
            DOUBLES_EQUAL(kLimit_Nm, to.torque_limit_Nm, 1e-12);
            DOUBLES_EQUAL(row.held_Nm, to.held_Nm, 1e-12);
            DOUBLES_EQUAL(row.held_Nm + (identifying ? 0 : 0.4), to.held_unknown_Nm, 1e-12);
            DOUBLES_EQUAL(0.625, to.creeping_rad_per_s, 1e-12);
            LONGS_EQUAL(span, to.span_cycles);
            DOUBLES_EQUAL(0.1 * span, to.full_impulse_Ns, 1e-12);  // 2 * 4 / 0.08 N
            DOUBLES_EQUAL(identifying ? row.known_Nm : 0, to.known_friction_Nm, 1e-12);
            DOUBLES_EQUAL(kUnseen_rad, to.unseen_from_rest_rad, 1e-12);  // no noise was measured
        }
    }
    // of steps twenty times the noise, and of what 400 rad/s^2 does in 6 ms
    for (const auto& [noise_rad, expected_rad] :
         {std::pair{1e-4, 3e-3 + 7.2e-3}, {1e-3, 3e-2 + 7.2e-3}, {5e-3, kUnseen_rad}}) {
        model::RobotParameters p = parameters();
        p.geometry = {{0.06, 0.1}, 0.4};
        p.dynamics.k7_per_kg_m = 4;
        p.dynamics.k8_per_kg_m2 = 20;
        p.velocity_loop.actuation_delay_s = 2e-3;
        p.velocity_loop.angle_noise_rad = noise_rad;
        DOUBLES_EQUAL(expected_rad, encoder_watch_settings(p, true).unseen_from_rest_rad, 1e-12);
        DOUBLES_EQUAL(std::max(expected_rad, kUnseen_rad / 2),
                      encoder_watch_settings(p, false).unseen_from_rest_rad, 1e-12);
    }
    // Reports that come seldom: three of them in a span, and four until a wheel stands.
    for (const auto& [period_ms, span, identifying_span] :
         {std::tuple{2, 10, 15}, {5, 15, 15}, {10, 30, 30}}) {
        model::RobotParameters p = parameters();
        p.geometry = {{0.06, 0.1}, 0.4};
        p.dynamics.k7_per_kg_m = 0.4;
        p.dynamics.k8_per_kg_m2 = 2;
        p.velocity_loop.actuation_delay_s = 2e-3;
        p.velocity_loop.angle_noise_rad = 1e-4;
        p.velocity_loop.observer_bandwidth_rad_per_s = 100;
        p.drive.encoder_period_ms = period_ms;
        LONGS_EQUAL(span, encoder_watch_settings(p, false).span_cycles);
        LONGS_EQUAL(identifying_span, encoder_watch_settings(p, true).span_cycles);
        LONGS_EQUAL(period_ms, encoder_watch_settings(p, true).report_cycles);
        const double late_s = 2e-3 + 4e-3 * period_ms;
        DOUBLES_EQUAL(3e-3 + 40 * late_s * late_s / 2, encoder_watch_settings(p, true).unseen_from_rest_rad,
                      1e-12);
    }
}
