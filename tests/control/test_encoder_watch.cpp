#include "firmware/control/encoder_watch.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <string>

#include "tests/control/inner_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

constexpr double kFriction_Nm = 0.3;
constexpr double kLimit_Nm = 4;

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
    std::function<WheelPair<double>(const WheelPair<double>&)> tell;  // what is told of the true angles

    explicit Watched(const bench::Truth& of = truth()) : robot(of, 7) {
        observer.configure(wheel_observer_settings<double>(parameters(), 1e-3));
        watch.configure(encoder_watch_settings(parameters(), false));
        drive({}, 100);
        watch.rest({robot.left.position_rad, robot.right.position_rad});
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
            if (watch.update(1e-3, told, {robot.left.time_ns, robot.right.time_ns}, observer, torque_Nm,
                             model, known))
                return k;
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
        LONGS_EQUAL(-1, w.drive(pushes(1, false), 300));
        LONGS_EQUAL(-1, w.drive(pushes(kLimit_Nm, false), 60));
        LONGS_EQUAL(-1, w.drive(pushes(1, false), 20));  // counts anew
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
