// The asymmetry is made here from Newton and Euler about the middle of the axle, with a matrix that is
// inverted, and not from the formulas of the code.
#include <array>
#include <cmath>
#include <vector>

#include "firmware/ident/cross_gains.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::ident;

namespace {

constexpr double kTrack_m = 0.47, kRadius_m = 0.081, kMass_kg = 17.3;

struct Seen {
    model::Dynamics<double> dynamics;  // in a torque's own direction
    std::array<CrossGain, 2> cross;
    double k7_alone, k8_alone;
    std::array<std::array<double, 2>, 2> friction;  // of 1 Nm at the left, at the right wheel: in v', omega'
};

// m v' - m p omega' = F, I omega' - m p v' = N; the left wheel gives 1 - c of what is asked, the right 1 + c.
Seen seen(double inertia_kg_m2, double offset_m, double c) {
    const double push = -kMass_kg * offset_m;
    const double determinant = kMass_kg * inertia_kg_m2 - push * push;
    const auto pushed = [&](double left_Nm, double right_Nm) {
        const double force_N = (left_Nm + right_Nm) / kRadius_m;
        const double yaw_Nm = (right_Nm - left_Nm) / kRadius_m * kTrack_m / 2;
        return std::array{(inertia_kg_m2 * force_N - push * yaw_Nm) / determinant,
                          (kMass_kg * yaw_Nm - push * force_N) / determinant};
    };
    const auto answer = [&](double left_Nm, double right_Nm) {
        return pushed((1 - c) * left_Nm, (1 + c) * right_Nm);
    };
    const auto both = answer(0.5, 0.5), against = answer(-0.5, 0.5);  // a sum, a difference of 1 Nm
    return {{0, 0, both[0], against[1]},
            {CrossGain{against[0], 1e-4 * both[0]}, CrossGain{both[1], 1e-4 * against[1]}},
            1 / (kMass_kg * kRadius_m),
            kTrack_m / (2 * kRadius_m * inertia_kg_m2),
            {pushed(1, 0), pushed(0, 1)}};
}

// Radius of gyration 0.4 of the track.
double usual_inertia() { return kMass_kg * 0.16 * kTrack_m * kTrack_m; }

}  // namespace

TEST_GROUP(CrossGains){};

TEST(CrossGains, offset_and_mismatch_come_back_alone_and_together) {
    for (const auto& [offset_share, c] :
         {std::array{0.06, 0.0}, {-0.11, 0.0}, {0.0, 0.07}, {0.0, -0.12}, {0.06, 0.05}, {-0.04, 0.08}}) {
        const Seen robot = seen(usual_inertia(), offset_share * kTrack_m, c);
        const Asymmetry found = asymmetry(robot.dynamics, robot.cross, kTrack_m);
        DOUBLES_EQUAL(offset_share, found.offset_m / kTrack_m, 0.001);
        DOUBLES_EQUAL(c, found.mismatch, 0.002);
        const auto alone = told_apart(robot.dynamics, found.mismatch, found.offset_m, kTrack_m);
        DOUBLES_EQUAL(1, alone.k7_per_kg_m / robot.k7_alone, 0.002);
        DOUBLES_EQUAL(1, alone.k8_per_kg_m2 / robot.k8_alone, 0.002);
        const auto together = seen_together(alone, found.mismatch, found.offset_m, kTrack_m);
        DOUBLES_EQUAL(robot.dynamics.k7_per_kg_m, together.k7_per_kg_m, 1e-9);
        DOUBLES_EQUAL(robot.dynamics.k8_per_kg_m2, together.k8_per_kg_m2, 1e-9);
    }
}

// A regression takes a wheel's friction for its sum, or for its difference, over the gain of torques.
TEST(CrossGains, a_friction_of_one_wheel_seems_more_or_less_than_it_is) {
    for (const auto& [offset_share, c] : {std::array{0.06, 0.0}, {-0.11, 0.0}, {0.08, -0.09}}) {
        const Seen robot = seen(usual_inertia(), offset_share * kTrack_m, c);
        for (std::size_t wheel = 0; wheel < 2; ++wheel) {
            const auto share = seen_of_one_wheel(wheel == 0 ? -1 : 1, robot.k8_alone / robot.k7_alone, c,
                                                 offset_share * kTrack_m, kTrack_m);
            DOUBLES_EQUAL(robot.friction[wheel][0] / robot.dynamics.k7_per_kg_m, share[0], 1e-12);
            DOUBLES_EQUAL(robot.friction[wheel][1] / robot.dynamics.k8_per_kg_m2,
                          (wheel == 0 ? -1 : 1) * share[1], 1e-12);
        }
    }
}

// Where the inertia is that of the mass over the wheels, both causes do the same: whatever is said makes the
// same cross gains.
TEST(CrossGains, where_the_causes_cannot_be_told_apart_their_sum_is_right) {
    const Seen robot = seen(kMass_kg * kTrack_m * kTrack_m / 4, 0.05 * kTrack_m, 0.03);
    const Asymmetry found = asymmetry(robot.dynamics, robot.cross, kTrack_m);
    const double q = 2 * found.offset_m / kTrack_m;
    const double k8 = robot.dynamics.k8_per_kg_m2 / (1 + found.mismatch * q);
    const double k7 = robot.dynamics.k7_per_kg_m - found.mismatch * found.offset_m * k8;
    const double forward = k7 * found.mismatch + found.offset_m * k8;
    const double turning = k8 * (found.mismatch + q);
    DOUBLES_EQUAL(robot.cross[0].value, forward, 0.005 * robot.dynamics.k7_per_kg_m);
    DOUBLES_EQUAL(robot.cross[1].value, turning, 0.005 * robot.dynamics.k8_per_kg_m2);
}

TEST(CrossGains, small_or_unsure_ones_are_no_effect) {
    const Seen small = seen(usual_inertia(), 0.002 * kTrack_m, 0.002);
    CHECK_EQUAL(0.0, asymmetry(small.dynamics, small.cross, kTrack_m).offset_m);
    CHECK_EQUAL(0.0, asymmetry(small.dynamics, small.cross, kTrack_m).mismatch);
    Seen unsure = seen(usual_inertia(), 0.06 * kTrack_m, 0.05);
    for (CrossGain& gain : unsure.cross) gain.standard_error = std::abs(gain.value) / 3;
    const Asymmetry none = asymmetry(unsure.dynamics, unsure.cross, kTrack_m);
    CHECK_EQUAL(0.0, none.offset_m);
    CHECK_EQUAL(0.0, none.mismatch);
}
