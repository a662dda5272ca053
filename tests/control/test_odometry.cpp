#include "firmware/control/odometry.hpp"

#include <cmath>
#include <cstdio>
#include <limits>

#include "tests/control/bench_robot.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

const model::Geometry<double> kGeometry{{0.0743, 0.0757}, 0.317};

OdometrySettings<double> settings() {
    OdometrySettings<double> s = odometry_settings<double>(model::default_parameters());
    return s;
}

// A robot on rails: true poses, and the wheel turns that its true geometry makes of them.
struct Rails {
    Pose<double> pose;
    model::Geometry<double> geometry;
    WheelPair<double> turned;
    void move(double v, double omega, double dt) {
        pose = model::advance_along_arc(pose, v * dt, omega * dt);
        const auto speed = model::wheel_speeds_from_twist(geometry, Twist<double>{v, omega});
        turned = {speed.left * dt, speed.right * dt};
    }
};

}  // namespace

TEST_GROUP(Odometry){};

TEST(Odometry, FollowsArcsExactlyWithUnequalWheels) {
    Odometry<double> odometry;
    odometry.configure(settings());
    odometry.set_pose({1, 2, 0.5});
    // A circle of 1.3 m radius: v = 0.91, omega = 0.7; a quarter of it.
    const auto speed = model::wheel_speeds_from_twist(kGeometry, Twist<double>{0.91, 0.7});
    const double time = bench::kPi / 2 / 0.7;
    const int cycles = 640;
    for (int k = 1; k <= cycles; ++k) {
        odometry.advance(kGeometry, {speed.left * time / cycles, speed.right * time / cycles},
                         1'000'000'000 + k * std::int64_t{1'000'000});
    }
    const double x = 1 + 1.3 * (std::sin(0.5 + bench::kPi / 2) - std::sin(0.5));
    const double y = 2 - 1.3 * (std::cos(0.5 + bench::kPi / 2) - std::cos(0.5));
    DOUBLES_EQUAL(x, odometry.pose().x_m, 1e-9);
    DOUBLES_EQUAL(y, odometry.pose().y_m, 1e-9);
    DOUBLES_EQUAL(x, odometry.bare_pose().x_m, 1e-9);
    DOUBLES_EQUAL(0.5 + bench::kPi / 2, odometry.pose().heading_rad, 1e-9);
}

TEST(Odometry, TheFirstExternalPoseSetsThePose) {
    Odometry<double> odometry;
    odometry.configure(settings());
    CHECK_FALSE(odometry.localised());
    CHECK(odometry.fuse({7, -3, 2}) == FixOutcome::first);
    CHECK(odometry.localised());
    DOUBLES_EQUAL(7, odometry.pose().x_m, 1e-12);
    DOUBLES_EQUAL(2, odometry.pose().heading_rad, 1e-12);
    DOUBLES_EQUAL(-3, odometry.bare_pose().y_m, 1e-12);
}

TEST(Odometry, LearnsTheErrorsOfRadiusAndTrackAndIsHonestAboutItsOwn) {
    Odometry<double> odometry;
    odometry.configure(settings());
    Rails rails{{0.3, -0.2, 0.1}, {{0.0743 * 1.004, 0.0757 * 1.002}, 0.317 * 0.994}, {}};
    bench::Noise noise(31);
    double normalised = 0, position = 0;
    int counted = 0;
    for (int k = 0; k < 60'000; ++k) {
        const double t = 1e-3 * k;
        rails.move(0.8 + 0.2 * std::sin(0.7 * t), 1.2 * std::sin(0.9 * t), 1e-3);
        odometry.advance(kGeometry, rails.turned, 1'000'000'000 + std::int64_t{1'000'000} * k);
        if (k % 50 == 0) {
            odometry.fuse({rails.pose.x_m + 0.002 * noise.gaussian(),
                           rails.pose.y_m + 0.002 * noise.gaussian(),
                           rails.pose.heading_rad + 0.004 * noise.gaussian()});
            if (k > 5000) {
                const double ex = odometry.pose().x_m - rails.pose.x_m;
                normalised += ex * ex / odometry.variance(0);
                position += ex * ex;
                ++counted;
            }
        }
    }
    // by the definition of the three constants
    const double left = 1.004, right = 1.002;
    const auto& c = odometry.calibration();
    const double distance = (0.0757 * right + 0.0743 * left) / (0.0757 + 0.0743) - 1;
    std::printf(
        "\n  distance %+.4f (is %+.4f), turn %+.4f, turn per metre %+.5f; x rms %.2f mm, normalised %.2f\n",
        c.distance, distance, c.turn, c.turn_per_m, 1e3 * std::sqrt(position / counted),
        normalised / counted);
    DOUBLES_EQUAL(distance, c.distance, 1e-3);
    DOUBLES_EQUAL(0.003 / 0.994 + 0.006 / 0.994, c.turn, 2e-3);
    // on a straight line the true robot turns by this much per metre measured
    DOUBLES_EQUAL((0.0757 * right * (1 / 0.0757) - 0.0743 * left * (1 / 0.0743)) / (0.317 * 0.994),
                  c.turn_per_m, 3e-3);
    CHECK(std::sqrt(position / counted) < 0.0015);
    CHECK(normalised / counted > 0.1 && normalised / counted < 1.3);  // cautious, for the rails do not slip
    CHECK_EQUAL(0U, odometry.doubted());
}

TEST(Odometry, AWildPoseIsDoubtedAndAPersistentOneBelieved) {
    Odometry<double> odometry;
    odometry.configure(settings());
    Rails rails{{}, kGeometry, {}};
    int k = 0;
    const auto run = [&](int cycles) {
        for (int i = 0; i < cycles; ++i, ++k) {
            rails.move(0.5, 0.3, 1e-3);
            odometry.advance(kGeometry, rails.turned, 1'000'000'000 + std::int64_t{1'000'000} * k);
        }
    };
    odometry.fuse(rails.pose);
    for (int i = 0; i < 20; ++i) {
        run(50);
        CHECK(odometry.fuse(rails.pose) == FixOutcome::fused);
    }
    run(50);
    CHECK(odometry.fuse({rails.pose.x_m + 0.5, rails.pose.y_m, rails.pose.heading_rad}) ==
          FixOutcome::doubted);
    DOUBLES_EQUAL(rails.pose.x_m, odometry.pose().x_m, 2e-3);
    run(50);
    CHECK(odometry.fuse(rails.pose) == FixOutcome::fused);
    CHECK(odometry.fuse({std::numeric_limits<double>::quiet_NaN(), 0, 0}) == FixOutcome::not_finite);
    rails.pose.x_m += 1.5;  // carried away
    FixOutcome last = FixOutcome::none;
    for (int i = 0; i < Odometry<double>::kDoubtsUntilRelocation; ++i) {
        CHECK(last != FixOutcome::relocated);
        run(50);
        last = odometry.fuse(rails.pose);
    }
    CHECK(last == FixOutcome::relocated);
    DOUBLES_EQUAL(rails.pose.x_m, odometry.pose().x_m, 1e-6);
    CHECK_EQUAL(11U, odometry.doubted());
}

TEST(Odometry, APoseThatComesLateCorrectsThePastItBelongsTo) {
    for (const bool told : {false, true}) {
        auto s = settings();
        s.delay_s = told ? 0.15 : 0.0;
        Odometry<double> odometry;
        odometry.configure(s);
        Rails rails{{}, kGeometry, {}};
        static Pose<double> past[20'000];
        double worst = 0;
        for (int k = 0; k < 20'000; ++k) {
            rails.move(1.0, 0.8, 1e-3);
            odometry.advance(kGeometry, rails.turned, 1'000'000'000 + std::int64_t{1'000'000} * k);
            past[k] = rails.pose;
            if (k >= 150 && k % 50 == 0) odometry.fuse(past[k - 150]);
            if (k > 5000) {
                worst = std::max(worst, std::hypot(odometry.pose().x_m - rails.pose.x_m,
                                                   odometry.pose().y_m - rails.pose.y_m));
            }
        }
        std::printf("\n  pose 150 ms late, %s: %.2f mm off", told ? "and told so" : "not told", 1e3 * worst);
        if (told) {
            CHECK(worst < 0.5e-3);
        } else {
            CHECK(worst > 0.1);
        }
    }
    std::printf("\n");
}

TEST(Odometry, APoseOfBeforeTheStartCorrectsTheFirstOneThatIsKnown) {
    auto s = settings();
    s.delay_s = 0.15;
    Odometry<double> odometry;
    odometry.configure(s);
    Rails rails{{}, kGeometry, {}};
    for (int k = 0; k < 30; ++k) {
        rails.move(1.0, 0, 1e-3);
        odometry.advance(kGeometry, rails.turned, 1'000'000'000 + std::int64_t{1'000'000} * k);
    }
    odometry.fuse({5, 3, 0});  // it was there 0.15 s ago, and has gone 30 mm since, as far as is known
    DOUBLES_EQUAL(5.03, odometry.pose().x_m, 2e-3);
    DOUBLES_EQUAL(3, odometry.pose().y_m, 1e-9);
}

TEST(Odometry, APoseInWhichOneNumberIsNoneIsRefused) {
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    Odometry<double> odometry;
    odometry.configure(settings());
    odometry.fuse({1, 2, 0.5});
    for (const Pose<double>& wrong : {Pose<double>{kNaN, 2, 0.5}, {1, kNaN, 0.5}, {1, 2, kNaN}}) {
        CHECK(odometry.fuse(wrong) == FixOutcome::not_finite);
        DOUBLES_EQUAL(1, odometry.pose().x_m, 1e-9);
        DOUBLES_EQUAL(2, odometry.pose().y_m, 1e-9);
        DOUBLES_EQUAL(0.5, odometry.pose().heading_rad, 1e-9);
    }
}

TEST(Odometry, ALongTimeWithoutExternalPosesWidensTheCovarianceAndTheNextIsTaken) {
    Odometry<double> odometry;
    odometry.configure(settings());
    Rails rails{{}, {{0.0743 * 1.003, 0.0757}, 0.317}, {}};
    odometry.fuse({});
    const double before = odometry.variance(0);
    for (int k = 0; k < 30'000; ++k) {
        rails.move(0.6, 0.2 * std::sin(1e-3 * k), 1e-3);
        odometry.advance(kGeometry, rails.turned, 1'000'000'000 + std::int64_t{1'000'000} * k);
    }
    const double off = std::hypot(odometry.pose().x_m - rails.pose.x_m, odometry.pose().y_m - rails.pose.y_m);
    std::printf("\n  after 18 m alone: %.0f mm off, standard deviations %.0f and %.0f mm\n", 1e3 * off,
                1e3 * std::sqrt(odometry.variance(0)), 1e3 * std::sqrt(odometry.variance(1)));
    CHECK(odometry.variance(0) > 100 * before);
    CHECK(off < 3 * std::sqrt(odometry.variance(0) + odometry.variance(1)));
    CHECK(odometry.fuse(rails.pose) == FixOutcome::fused);
    DOUBLES_EQUAL(rails.pose.x_m, odometry.pose().x_m, 0.01);
}

TEST(Odometry, ParkedForTenMinutesItStaysAwakeAndAPushIsNoticed) {
    Odometry<double> odometry;
    odometry.configure(settings());
    bench::Noise noise(35);
    int k = 0;
    double worst = 0;
    const auto park = [&](double x, int fixes) {
        for (int i = 0; i < fixes; ++i) {
            for (int j = 0; j < 50; ++j, ++k) {
                odometry.advance(kGeometry, {}, 1'000'000'000 + std::int64_t{1'000'000} * k);
            }
            odometry.fuse({x + 0.002 * noise.gaussian(), 0.002 * noise.gaussian(), 0.004 * noise.gaussian()});
        }
    };
    park(0, 20);
    for (int minute = 0; minute < 10; ++minute) {
        park(0, 1200);
        worst = std::max(worst, std::hypot(odometry.pose().x_m, odometry.pose().y_m));
    }
    const double sigma = std::sqrt(odometry.variance(0));
    park(0.006, 60);  // pushed by 6 mm, which no wheel has felt; 3 s later
    std::printf("\n  parked: %.2f mm off at most, standard deviation %.2f mm; after a push of 6 mm %.2f mm\n",
                1e3 * worst, 1e3 * sigma, 1e3 * odometry.pose().x_m);
    CHECK(worst < 2e-3);
    CHECK(sigma > 0.1e-3 && sigma < 1e-3);
    DOUBLES_EQUAL(0.006, odometry.pose().x_m, 1.5e-3);
    CHECK(std::abs(odometry.calibration().distance) < 0.02);
}

TEST(Odometry, SinglePrecisionKeepsACovarianceThatIsOne) {
    Odometry<float> odometry;
    odometry.configure(odometry_settings<float>(model::default_parameters()));
    const model::Geometry<float> geometry{{0.0743F, 0.0757F}, 0.317F};
    Rails rails{{}, {{0.0745, 0.0757}, 0.316}, {}};
    bench::Noise noise(33);
    double worst = 0;
    for (int k = 0; k < 120'000; ++k) {
        const double t = 1e-3 * k;
        rails.move(0.9, 1.1 * std::sin(0.8 * t), 1e-3);
        odometry.advance(geometry, {float(rails.turned.left), float(rails.turned.right)},
                         1'000'000'000 + std::int64_t{1'000'000} * k);
        if (k % 50 != 0) continue;
        odometry.fuse({float(rails.pose.x_m + 0.002 * noise.gaussian()),
                       float(rails.pose.y_m + 0.002 * noise.gaussian()),
                       float(rails.pose.heading_rad + 0.004 * noise.gaussian())});
        for (std::size_t i = 0; i < 6; ++i) CHECK(odometry.variance(i) > 0);
        if (k > 5000)
            worst = std::max(worst, std::hypot(double(odometry.pose().x_m) - rails.pose.x_m,
                                               double(odometry.pose().y_m) - rails.pose.y_m));
    }
    std::printf("\n  float, two minutes: %.2f mm off at most\n", 1e3 * worst);
    CHECK(worst < 0.01);
}
