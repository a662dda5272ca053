// A watch that is told what a table says, no robot between. Its robot's numbers are powers of two, so that
// what a table says is met to the last digit.
#include "firmware/control/encoder_watch.hpp"

#include <array>
#include <cmath>
#include <string>

#include "tests/control/inner_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

constexpr double kElapsed_s = 0x1p-10;
constexpr double kUnseen_rad = 1.5 * 2 * bench::kPi / 64;
constexpr WheelPair<double> kRadius_m{0.0625, 0.125};
constexpr double kTrack_m = 0.5, kK7 = 0.5, kK8 = 4;
constexpr WheelPair<double> kOwn_per_Nm{24, 12};  // rad/s^2 of a wheel by its own torque: K7 / r + K8 b / 2r
// limit, held, creeping, span, full, known; full torque makes 0.625 rad/s, by K8 b / 2
constexpr EncoderWatchSettings kSettings{4, 1.25, 0.5, 8, 0.625, 0};
// In a cycle, half more than full torque of both wheels, by the plant: 1.5 K8 b / r 4 Nm.
constexpr WheelPair<double> kBrakes_rad_per_s{1.5 * 32 * 4 * kElapsed_s, 1.5 * 16 * 4 * kElapsed_s};

double& of(WheelPair<double>& pair, bool right) { return right ? pair.right : pair.left; }
double of(const WheelPair<double>& pair, bool right) { return right ? pair.right : pair.left; }
WheelPair<double> one(bool right, double its, double others) {
    return right ? WheelPair<double>{others, its} : WheelPair<double>{its, others};
}

struct Cycle {
    WheelPair<double> speed_rad_per_s, acting_Nm, unexplained_rad_per_s2, torque_Nm;
    std::array<bool, 2> stands{};
    std::array<bool, 2> old_frames{};
};

struct Told {
    PlantModel<double> plant;
    PlantModel<double> expects;  // the observer's, where it differs
    EncoderWatch watch;
    EncoderWatchSettings settings = kSettings;
    WheelObserver<double> observer;
    WheelObserverSettings<double> observed;
    WheelPair<double> angle_rad{0.25, -0.75};
    std::int64_t now_ns = 5'000'000'000;
    std::array<std::int64_t, 2> told_ns{now_ns, now_ns};
    bool known = true;
    WheelPair<double> speed_rad_per_s;  // of the last span

    explicit Told(const EncoderWatchSettings& of_watch = kSettings) : settings(of_watch) {
        plant.geometry = {kRadius_m, kTrack_m};
        plant.dynamics = {1e-30, 0, kK7, kK8};  // K5 is known, and next to nothing
        plant.effects = {};
        expects = plant;
        observed.cycle_s = observed.encoder_period_s = 1e-3;
        observed.bandwidth_rad_per_s = 90;
        observed.calm_acceleration_rad_per_s2 = 1e12;
        observed.fastest_rad_per_s = 150;
        observer.configure(observed);
        watch.configure(settings);
        watch.rest(told());
    }

    // Behind a loop: what is told goes on, the angle is known as well as this.
    WheelPair<double> crept_rad, unsure_rad;
    std::array<bool, 2> tells_the_same{};

    std::array<EncoderAngle, 2> told() const {
        auto angles = bench::told_angles(angle_rad, told_ns);
        for (const bool right : {false, true}) {
            EncoderAngle& angle = angles[right];
            angle.angle_rad += of(crept_rad, right);
            angle.position_rad = tells_the_same[right] ? 0.125 : angle.angle_rad + 7;
            angle.unsure_rad = of(unsure_rad, right);
        }
        return angles;
    }

    bool update(EncoderWatch& asked, const Cycle& c) {
        // An observer takes over the speed of its first sample; what it does not explain comes of a second
        // one.
        const auto gains = observer_gains<double>(observed.bandwidth_rad_per_s, 1e-3);
        const auto samples = [&](bool second, std::int64_t at_ns) {
            std::array<EncoderSample, 2> to;
            for (const bool right : {false, true}) {
                const double off_rad = of(c.unexplained_rad_per_s2, right) / gains.error_per_s2;
                const double first = of(c.speed_rad_per_s, right) - gains.speed_per_s * off_rad;
                to[right] = {second ? first * 1e-3 + off_rad : 0, first, at_ns};
            }
            observer.update(at_ns, to[0], to[1], expects);
        };
        observer.reset();
        if (c.unexplained_rad_per_s2.left != 0 || c.unexplained_rad_per_s2.right != 0) {
            samples(false, now_ns - 1'000'000);
            samples(true, now_ns);
        } else {
            observer.torque_sent(c.acting_Nm);
            samples(false, now_ns);
        }
        return asked.update(kElapsed_s, told(), observer, c.torque_Nm, plant, known);
    }

    // True: an encoder is not believed.
    bool cycle(const Cycle& c, bool look = true) {
        now_ns += 1'000'000;
        for (const std::size_t i : {0, 1})
            if (!c.old_frames[i]) told_ns[i] = now_ns;
        if (!c.stands[0]) angle_rad.left += 0.01;
        if (!c.stands[1]) angle_rad.right -= 0.01;
        const bool lies = update(watch, c);
        if (look) watch.look(observer.motion().wheel_speed_rad_per_s, plant);
        return lies;
    }

    // In how many such cycles it is not believed; 0: in none of `most`.
    int cycles(const Cycle& c, int most) {
        for (int n = 1; n <= most; ++n)
            if (cycle(c)) return n;
        return 0;
    }

    // The torques that make such accelerations.
    WheelPair<double> torques_for(const WheelPair<double>& rad_per_s2) const {
        const double v = (kRadius_m.right * rad_per_s2.right + kRadius_m.left * rad_per_s2.left) / 2;
        const double omega =
            (kRadius_m.right * rad_per_s2.right - kRadius_m.left * rad_per_s2.left) / kTrack_m;
        const double sum = v / expects.dynamics.k7_per_kg_m,
                     difference = omega / expects.dynamics.k8_per_kg_m2;
        return {(sum - difference) / 2, (sum + difference) / 2};
    }

    // A span with these torques that ends at this speed. True: after it, an encoder is not believed.
    bool pushed(const WheelPair<double>& ends_rad_per_s, const WheelPair<double>& acting_Nm, int cycles = 0) {
        if (cycles == 0) cycles = settings.span_cycles;
        speed_rad_per_s = ends_rad_per_s;
        const Cycle c{speed_rad_per_s, acting_Nm, {}, {}};
        for (int i = 1; i <= cycles; ++i) CHECK_FALSE(cycle(c, i == cycles));
        EncoderWatch after = watch;
        return update(after, c);
    }
    bool span(const WheelPair<double>& ends_rad_per_s, const WheelPair<double>& expected_gain,
              int cycles = 0) {
        const double by = 1 / (kElapsed_s * (cycles == 0 ? settings.span_cycles : cycles));
        return pushed(ends_rad_per_s, torques_for({by * expected_gain.left, by * expected_gain.right}),
                      cycles);
    }
    bool gains(const WheelPair<double>& told, const WheelPair<double>& expected, int cycles = 0) {
        return span({speed_rad_per_s.left + told.left, speed_rad_per_s.right + told.right}, expected, cycles);
    }
    void spans(int count, const WheelPair<double>& rad_per_s) {
        for (int i = 0; i < count; ++i) CHECK_FALSE(span(rad_per_s, {}));
    }
};

// The first cycle after which sum(speed + a dt k) dt is too much unseen.
int first_unseen(double speed_rad_per_s, double rad_per_s2) {
    const double step = std::abs(rad_per_s2) * kElapsed_s * kElapsed_s;
    const double start = std::abs(speed_rad_per_s) * kElapsed_s + step / 2;
    const double n =
        step > 0 ? (std::sqrt(start * start + 2 * step * kUnseen_rad) - start) / step : kUnseen_rad / start;
    return static_cast<int>(std::floor(n)) + 1;
}

// The same with a speed that falls by so much in each cycle; 0: it comes to rest before.
int first_unseen_braked(double speed_rad_per_s, double brakes_rad_per_s) {
    double speed = std::abs(speed_rad_per_s), unseen_rad = 0;
    for (int n = 1; (speed -= brakes_rad_per_s) > 0; ++n)
        if ((unseen_rad += speed * kElapsed_s) > kUnseen_rad) return n;
    return 0;
}

std::string name(bool right, double value) { return (right ? "right " : "left ") + std::to_string(value); }

}  // namespace

TEST_GROUP(EncoderWatchTable){};

// Each wheel counts from its own last change, in the direction of the torque; what holds it is friction, and
// what holds it against the body's own turning.
TEST(EncoderWatchTable, a_wheel_that_its_torque_must_have_turned_too_far_is_seen_in_that_cycle) {
    for (const double torque_Nm : {0.5, 1.25, 1.5, 2.0, 2.25, 2.875, 3.0, 4.0}) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                Told t;
                const Cycle before{one(right, sign * 0.5, 7), {}, {}, one(right, 1.5, 3)};
                LONGS_EQUAL(0, t.cycles(before, 32));
                Cycle c{{}, {}, {}, one(right, sign * torque_Nm, -2)};
                c.stands[right] = true;
                const double beyond_Nm = torque_Nm - 1.25;
                const int expected = beyond_Nm > 0 ? first_unseen(0, of(kOwn_per_Nm, right) * beyond_Nm) : 0;
                LONGS_EQUAL_TEXT(expected, t.cycles(c, 500), name(right, sign * torque_Nm).c_str());
            }
        }
    }
}

TEST(EncoderWatchTable, behind_a_loop_a_wheel_stands_where_its_angle_does_as_far_as_it_is_known) {
    constexpr double kUnsure_rad = 0x1p-8;
    struct Row {
        double creeps_rad;  // in each frame, to and fro after the fourth
        double unsure_rad;  // when it stands
        bool tells_the_same, stands;
    };
    const Row rows[] = {
        {0, 0, false, true},
        {0.999 * kUnsure_rad, kUnsure_rad, false, true},  // four of them are more
        {0.999 * kUnsure_rad, 0, false, true},            // where it was so unsure in its fourth frame
        {1.001 * kUnsure_rad, kUnsure_rad, false, false},
        {1.001 * kUnsure_rad, 0, true, true},
    };
    for (const Row& row : rows) {
        for (const bool right : {false, true}) {
            Told t;
            of(t.unsure_rad, right) = kUnsure_rad;
            LONGS_EQUAL(0, t.cycles({{}, {}, {}, one(right, 1.5, 3)}, 32));
            t.tells_the_same[right] = row.tells_the_same;
            if (row.tells_the_same) LONGS_EQUAL(0, t.cycles({{}, {}, {}, one(right, 1.5, 3)}, 1));
            Cycle c{{}, {}, {}, one(right, 2, -2)};
            c.stands[right] = true;
            const int expected = first_unseen(0, of(kOwn_per_Nm, right) * 0.75);
            int seen = 0;
            for (int n = 1; n <= 500 && seen == 0; ++n) {
                of(t.crept_rad, right) += n <= 5 || n % 2 == 0 ? row.creeps_rad : -row.creeps_rad;
                if (n > 5) of(t.unsure_rad, right) = row.unsure_rad;
                if (t.cycle(c)) seen = n;
            }
            LONGS_EQUAL_TEXT(row.stands ? expected : 0, seen, name(right, row.creeps_rad).c_str());
        }
    }
}

// The speed of 16 to 32 cycles before it stood, less what half more than full torque brakes it by since then,
// and while the torque is against it.
TEST(EncoderWatchTable, a_wheel_that_stands_at_once_goes_on_unseen_as_fast_as_it_was_at_least) {
    struct Row {
        int cycles;  // with speed: 1 rad/s faster in each
        double at_first, torque_Nm;
        double speed_at;  // the cycle whose speed counts; 0: it may stand
    };
    const Row rows[] = {
        {31, 40, 0, 0},     {32, 40, 0, 16},  {32, -12, 0, 16}, {40, -8, 0, 16},
        {47, -8, 0, 16},    {48, -12, 0, 32}, {32, 4, 0, 16},   {32, 4, 1, 16},
        {32, 4, -0.01, 16}, {32, -6, -1, 16}, {32, -15, 0, 0},  {32, -12, 1.5, 16},
    };
    for (const Row& row : rows) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                Told t;
                for (int i = 1; i <= row.cycles; ++i)
                    CHECK_FALSE(t.cycle({one(right, sign * (row.at_first + i), 2), {}, {}, {}}));
                Cycle c{{}, {}, {}, one(right, sign * row.torque_Nm + 0.0, 0)};
                c.stands[right] = true;
                const double was = row.at_first + row.speed_at;
                const double least = was - of(kBrakes_rad_per_s, right) * (16 + row.cycles % 16);
                const int unseen =
                    row.torque_Nm < 0
                        ? first_unseen_braked(least, of(kBrakes_rad_per_s, right))
                        : first_unseen(least, of(kOwn_per_Nm, right) * std::max(row.torque_Nm - 1.25, 0.0));
                const int expected = row.speed_at > 0 && unseen > 0 ? std::max(unseen, 5) : 0;
                LONGS_EQUAL_TEXT(expected, t.cycles(c, 500), name(right, sign * was).c_str());
            }
        }
    }
}

// A speed is a former one after 16 cycles and four reports.
TEST(EncoderWatchTable, a_speed_that_is_told_seldom_counts_as_long_as_four_reports_take) {
    struct Row {
        int report_cycles, reports;
    };
    for (const Row& row : {Row{1, 16}, Row{2, 8}, Row{3, 5}, Row{5, 4}, Row{8, 4}}) {
        EncoderWatchSettings seldom = kSettings;
        seldom.report_cycles = row.report_cycles;
        for (const bool right : {false, true}) {
            Told t(seldom);
            const auto report = [&](Cycle c) {
                for (int i = 1; i <= row.report_cycles; ++i) {
                    if (t.cycle(c)) return i;
                    c.stands = c.old_frames = {true, true};
                }
                return 0;
            };
            for (int i = 1; i <= 2 * row.reports; ++i)
                LONGS_EQUAL(0, report({one(right, 40 + i, 2), {}, {}, {}}));
            Cycle c{};
            c.stands[right] = true;
            const double least =
                40 + row.reports - of(kBrakes_rad_per_s, right) * (row.reports * row.report_cycles);
            // It turns unseen from the first report's last cycle on; five reports have the same angle at
            // least.
            const int unseen = row.report_cycles - 1 + first_unseen(least, 0);
            int seen = 0;
            for (int n = 0; n < 40 && seen == 0; ++n)
                if (const int i = report(c); i > 0) seen = n * row.report_cycles + i;
            LONGS_EQUAL_TEXT(std::max(unseen, 4 * row.report_cycles + 1), seen,
                             name(right, row.report_cycles).c_str());
        }
    }
}

// What a wheel that stood may turn follows from its encoder; one that turned, more than a brake can have
// stopped in 16 cycles, is believed as long as any is.
TEST(EncoderWatchTable, a_wheel_that_stood_may_turn_less_unseen_where_its_encoder_is_fine) {
    EncoderWatchSettings fine = kSettings;
    fine.unseen_from_rest_rad = 0.02;
    for (const bool right : {false, true}) {
        for (const double more : {0.0, 0.5}) {
            Told t(fine);
            const double speed = of(kBrakes_rad_per_s, right) * 16 + more;
            LONGS_EQUAL(0, t.cycles({one(right, speed, 2), {}, {}, {}}, 32));
            Cycle c{{}, {}, {}, one(right, 2, 0)};
            c.stands[right] = true;
            const int coarse = first_unseen(more, of(kOwn_per_Nm, right) * 0.75);
            const int seen = t.cycles(c, 500);
            const double share = std::sqrt(fine.unseen_from_rest_rad / kUnseen_rad);
            if (more == 0) DOUBLES_EQUAL(share * coarse, seen, 1.5);
            if (more > 0) LONGS_EQUAL(coarse, seen);
        }
    }
}

// Not even when a brake may have stopped it since.
TEST(EncoderWatchTable, a_wheel_that_turned_is_believed_as_long_as_any_is_when_it_was_braked) {
    EncoderWatchSettings fine = kSettings;
    fine.unseen_from_rest_rad = 0.02;
    for (const bool right : {false, true}) {
        Told t(fine);
        LONGS_EQUAL(0, t.cycles({one(right, of(kBrakes_rad_per_s, right) * 16 + 0.1, 2), {}, {}, {}}, 32));
        Cycle c{{}, {}, {}, one(right, -0.5, 0)};
        c.stands[right] = true;
        LONGS_EQUAL(0, t.cycles(c, 8));
        of(c.torque_Nm, right) = 2;
        LONGS_EQUAL(first_unseen(0, of(kOwn_per_Nm, right) * 0.75), t.cycles(c, 500));
    }
}

// Five frames with one angle at least, however fast it was.
TEST(EncoderWatchTable, the_same_frame_again_says_nothing_new) {
    for (const bool right : {false, true}) {
        Told t;
        LONGS_EQUAL(0, t.cycles({one(right, 100, 2), {}, {}, {}}, 32));
        Cycle c;
        c.stands[right] = true;
        for (int n = 1; n <= 13; ++n) {
            c.old_frames[right] = n % 3 != 1;
            LONGS_EQUAL_TEXT(n >= 13, t.cycle(c), std::to_string(n).c_str());
        }
    }
}

TEST(EncoderWatchTable, what_was_unseen_is_forgotten_when_the_angle_changes_or_nothing_drives) {
    const int turned = first_unseen(0, kOwn_per_Nm.left * 0.75);
    for (const bool rests : {false, true}) {
        Told t;
        if (rests) LONGS_EQUAL(0, t.cycles({{40, 40}, {}, {}, {1, 1}}, 48));
        Cycle c{{}, {}, {}, {2, 0}, {true, false}};
        if (!rests) LONGS_EQUAL(0, t.cycles(c, turned - 1));
        if (rests) {
            t.angle_rad = {-1.5, 3};
            t.watch.rest(t.told());
        } else {
            CHECK_FALSE(t.cycle({}));
        }
        LONGS_EQUAL(turned, t.cycles(c, 500));
    }
}

// A body that turns pulls at its wheels by K5 and K6, and a slope by what it did to the wheel while it
// turned.
TEST(EncoderWatchTable, a_turning_body_and_a_slope_may_hold_a_wheel) {
    for (const bool right : {false, true}) {
        for (const int sign : {1, -1}) {
            for (const double torque_Nm : {2.875, 3.0, 3.5}) {
                Told t;
                t.plant.dynamics.k5_m = 0.01;
                t.plant.dynamics.k6_per_m = -0.8;
                const WheelPair<double> speed{8, sign * 24.0};
                const double v = (kRadius_m.right * speed.right + kRadius_m.left * speed.left) / 2;
                const double omega = (kRadius_m.right * speed.right - kRadius_m.left * speed.left) / kTrack_m;
                const double sum = -0.01 * omega * omega / kK7, difference = 0.8 * v * omega / kK8;
                const double holds_Nm = (right ? sum + difference : sum - difference) / 2;
                Cycle c{speed, {}, {}, one(right, sign * torque_Nm, 0)};
                c.stands[right] = true;
                const double beyond_Nm = torque_Nm - 1.25 - std::max(sign * holds_Nm, 0.0);
                CHECK(std::abs(holds_Nm) > 0.2);
                LONGS_EQUAL_TEXT(first_unseen(0, of(kOwn_per_Nm, right) * beyond_Nm), t.cycles(c, 500),
                                 name(right, sign * torque_Nm).c_str());

                // One that was seen 16 to 32 changes of angle ago, or in those since; either way as much as
                // the other wheel has shown in those.
                for (const bool lately : {false, true}) {
                    Told s;
                    const double slope_Nm = 0.5, radius_m = of(kRadius_m, right);
                    const double beside_Nm = 1 / (2 * kK7 / radius_m);
                    Cycle turns{{}, {}, one(right, -sign * slope_Nm * 2 * kK7 / radius_m, -1), {}};
                    const Cycle level{{}, {}, one(right, sign * 1e-9, -1), {}};
                    LONGS_EQUAL(0, s.cycles(lately ? level : turns, 16));
                    LONGS_EQUAL(0, s.cycles(lately ? turns : level, 16));
                    for (const int way : {1, -1}) {
                        Cycle pushed{{}, {}, one(right, 0, -1), one(right, way * sign * torque_Nm, 0)};
                        pushed.stands[right] = true;
                        const double held_Nm = torque_Nm < 3 ? (way > 0 ? slope_Nm : beside_Nm) : 0;
                        const double more_Nm = torque_Nm - 1.25 - held_Nm;
                        LONGS_EQUAL_TEXT(first_unseen(0, of(kOwn_per_Nm, right) * more_Nm),
                                         s.cycles(pushed, 500), name(right, sign * torque_Nm).c_str());
                        CHECK_FALSE(s.cycle(turns));
                    }
                }
            }
        }
    }
}

TEST(EncoderWatchTable, without_a_model_80_cycles_in_a_row_of_more_than_friction_holds_are_too_many) {
    for (const bool right : {false, true}) {
        for (const int sign : {1, -1}) {
            Told t;
            t.known = false;
            Cycle c{{}, {}, {}, one(right, sign * 1.5, 0)}, held = c;
            c.stands[right] = held.stands[right] = true;
            of(held.torque_Nm, right) = sign * 1.25;
            LONGS_EQUAL(0, t.cycles(held, 200));
            LONGS_EQUAL(0, t.cycles(c, 79));
            CHECK_FALSE(t.cycle(held));
            LONGS_EQUAL(0, t.cycles(c, 79));
            CHECK_FALSE(t.cycle({}));
            LONGS_EQUAL(0, t.cycles(c, 79));
            t.watch.rest(t.told());
            LONGS_EQUAL(80, t.cycles(c, 100));
            // The cycle of a change is none of them.
            Cycle turns = c;
            of(turns.torque_Nm, right) = sign * 3.5;
            Cycle full = turns;
            turns.stands[right] = false;
            CHECK_FALSE(t.cycle(turns));
            LONGS_EQUAL(80, t.cycles(full, 100));
        }
    }
}

namespace {

// What an unseen wheel can do on a level floor, stated a second time, wheel by wheel.
struct LevelFloor {
    struct Noted {
        double speed = 0, changed = 0;
    };
    struct Wheel {
        Noted before, lately;
        int age = 0, frames = -1;
        bool rest = false;
        double slowest = 0, fastest = 0, back = 0, ahead = 0, time_s = 0;
    };
    EncoderWatchSettings settings;
    double k6_per_m;
    std::array<Wheel, 2> wheels{};

    // By a push of p, a speed that friction of `with` holds back when forward, `against` when backward.
    static double next(double speed, double gain, double p, double with, double against) {
        const double forward = (speed > 0 ? speed : 0) + gain * (p - with);
        const double backward = (speed < 0 ? speed : 0) + gain * (p + against);
        return (forward > 0 ? forward : 0) + (backward < 0 ? backward : 0);
    }

    bool cycle(const Cycle& c) {
        const std::array<double, 2> radius{kRadius_m.left, kRadius_m.right};
        const std::array<double, 2> torque{c.torque_Nm.left, c.torque_Nm.right};
        const std::array<double, 2> speed{c.speed_rad_per_s.left, c.speed_rad_per_s.right};
        const double forward = kK7, turning = kK8 * kTrack_m / 2, friction = settings.known_friction_Nm;
        const double v = (radius[0] * speed[0] + radius[1] * speed[1]) / 2;
        const double omega = (radius[1] * speed[1] - radius[0] * speed[0]) / kTrack_m;
        const double holds_right = -k6_per_m * v * omega / kK8 / 2;
        bool lies = false;
        for (const std::size_t i : {0U, 1U}) {
            Wheel& w = wheels[i];
            const std::size_t o = 1 - i;
            const double changed = kElapsed_s / radius[i] *
                                   ((forward + turning) * (std::abs(torque[i]) + friction) +
                                    std::abs(forward - turning) * (std::abs(torque[o]) + friction));
            w.before.changed += changed;
            w.lately.changed += changed;
            if (!c.stands[i]) {
                w.frames = -1;
                if (++w.age == 16) {
                    w.before = w.lately;
                    w.lately = {speed[i], 0};
                    w.age = 0;
                }
                continue;
            }
            if (++w.frames == 0) {
                const double by = 1.5 * w.before.changed;
                w = {w.before,
                     w.lately,
                     w.age,
                     0,
                     std::abs(w.before.speed) <= by,
                     w.before.speed - by,
                     w.before.speed + by};
            }
            const bool creeps = std::abs(speed[o]) <= settings.creeping_rad_per_s;
            double least = torque[o] - (creeps || speed[o] > 0 ? friction : 0);
            double most = torque[o] + (creeps || speed[o] < 0 ? friction : 0);
            if (creeps && c.stands[o]) least = most = 0;
            const double coupling = (forward - turning) / (forward + turning);  // negative
            const double holds = i == 1 ? holds_right : -holds_right;
            const double gain = kElapsed_s * (forward + turning) / radius[i];
            const double held = settings.held_Nm;
            w.slowest =
                next(w.slowest, gain, torque[i] + coupling * most - std::max(holds, 0.0), held, held / 2.25);
            w.fastest =
                next(w.fastest, gain, torque[i] + coupling * least - std::min(holds, 0.0), held / 2.25, held);
            w.back += kElapsed_s * w.slowest;
            w.ahead += kElapsed_s * w.fastest;
            w.time_s += kElapsed_s;
            const double room = w.rest ? settings.unseen_from_rest_rad : kUnseen_rad;
            if (w.frames < 4) continue;
            if (w.back > room || w.ahead < -room) {
                lies = true;
                continue;
            }
            if (w.back < -room) {
                w.slowest += (-room - w.back) / w.time_s;
                w.back = -room;
            }
            if (w.ahead > room) {
                w.fastest -= (w.ahead - room) / w.time_s;
                w.ahead = room;
            }
            if (!w.rest && w.slowest <= 0 && w.fastest >= 0) {
                w.rest = true;
                w.back = w.ahead = w.time_s = 0;
            }
        }
        return lies;
    }
};

}  // namespace

TEST(EncoderWatchTable, on_a_level_floor_it_follows_all_that_an_unseen_wheel_can_do) {
    EncoderWatchSettings settings = kSettings;
    settings.known_friction_Nm = 0.25;
    settings.held_Nm = 0.375;
    bench::Noise random(17);
    const auto up_to = [&random](double most) { return most * (2 * random.uniform() - 1); };
    int seen = 0, cycles = 0;
    for (int run = 0; run < 4000; ++run) {
        settings.unseen_from_rest_rad = run % 2 == 0 ? 0.01 : 0.04;
        Told t(settings);
        t.plant.dynamics.k6_per_m = -0.8;
        LevelFloor expects{settings, -0.8};
        Cycle c;
        int left = 0;
        for (int n = 0; n < 400; ++n) {
            if (left-- == 0) {
                left = 3 + static_cast<int>(40 * random.uniform());
                const double gentle = random.uniform() < 0.5 ? 0.4 : 2;
                const double slow = random.uniform() < 0.3 ? 0.4 : 8;
                c.torque_Nm = {up_to(gentle), up_to(gentle)};
                if (random.uniform() < 0.2) c.torque_Nm = {};
                c.speed_rad_per_s = {up_to(slow), up_to(slow)};
                if (random.uniform() < 0.1)
                    c.speed_rad_per_s = {settings.creeping_rad_per_s, -settings.creeping_rad_per_s};
                const double which = n < 40 ? 1 : random.uniform();
                const bool right_stands = which > 0.2 && which < 0.6;
                c.stands = {which < 0.4, right_stands};
            }
            ++cycles;
            const bool lies = expects.cycle(c);
            CHECK_EQUAL_TEXT(lies, t.cycle(c, false),
                             (std::to_string(run) + " " + std::to_string(n)).c_str());
            if (!lies) continue;
            ++seen;
            break;
        }
    }
    std::printf("  %d cycles, %d lies\n", cycles, seen);
    CHECK(seen > 1000 && seen < 3800);
}

TEST(EncoderWatchTable, both_encoders_that_leap_at_once_are_not_believed) {
    for (const int leaps : {0, 1, 2, 3}) {  // bits: left, right
        Told t;
        WheelPair<double> told;
        const auto next = [&] {
            t.now_ns += 1'000'000;
            t.observer.update(t.now_ns, {told.left, 0, t.now_ns}, {told.right, 0, t.now_ns}, t.plant);
            return t.watch.update(kElapsed_s, bench::told_angles(told, {t.now_ns, t.now_ns}), t.observer, {},
                                  t.plant, true);
        };
        t.observer.reset();
        for (int i = 0; i < 10; ++i) {
            told = {0.001 * i, 0.002 * i};
            CHECK_FALSE(next());
        }
        told = {told.left + (leaps & 1 ? 2 : 0), told.right - (leaps & 2 ? 2 : 0)};
        CHECK_FALSE(next());
        LONGS_EQUAL(leaps == 3, next());
    }
}

// Two spans in a row, against four spans before the second.
TEST(EncoderWatchTable, a_speed_that_is_the_mirror_image_of_what_it_was_or_the_other_wheels_is_not_believed) {
    struct Row {
        WheelPair<double> was, told;
        bool lies;
    };
    const double s = 4;
    const Row rows[] = {
        {{s, s}, {-s, s}, true},
        {{s, 0}, {-s, 0}, true},
        {{s, -s}, {-s, -s}, true},
        {{s, s}, {-1.5 * s, s}, true},
        {{s, s}, {-1.51 * s, s}, false},
        {{s, s}, {-0.5 * s, s}, true},
        {{s, s}, {-0.49 * s, s}, false},
        {{s, s}, {-s, 1.5 * s}, true},
        {{s, s}, {-s, 1.51 * s}, false},
        {{s, s}, {-s, 0.5 * s}, true},
        {{s, s}, {-s, 0.49 * s}, false},
        {{s, s}, {-s, -s}, false},
        {{2.5, 0}, {-2.5, 0}, true},
        {{2.49, 0}, {-2.49, 0}, false},
        {{-2.5, 1}, {2.5, 1}, true},
        {{s, s}, {s, s}, false},
        {{s, s}, {0, s}, false},
        // exchanged: half of what lies between them counts
        {{5, 0}, {0, 5}, true},
        {{4.99, 0}, {0, 4.99}, false},
        {{6, 1}, {1, 6}, true},
        {{s, -s}, {-s, s}, true},
        {{-7, -2}, {-2, -7}, true},
        {{8, 0}, {2, 8}, true},
        {{8, 0}, {2.01, 8}, false},
        {{8, 0}, {0, 6}, true},
        {{8, 0}, {0, 5.99}, false},
        {{8, 0}, {-2, 8}, true},
        {{8, 0}, {0, 10}, true},
    };
    for (const Row& row : rows) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                const auto as = [&](const WheelPair<double>& speed) {
                    return one(right, sign * speed.left, sign * speed.right);
                };
                Told t;
                t.spans(70, as(row.was));
                CHECK_FALSE(t.span(as(row.told), {}));
                const std::string text =
                    name(right, sign * row.told.left) + ", " + std::to_string(row.told.right);
                LONGS_EQUAL_TEXT(row.lies, t.span(as(row.told), {}), text.c_str());
                t.known = false;
                EncoderWatch unknown = t.watch;
                CHECK_FALSE(t.update(unknown, {}));
                t.known = true;
                t.watch.rest(t.told());
                EncoderWatch rested = t.watch;
                CHECK_FALSE(t.update(rested, {}));
            }
        }
    }
}

TEST(EncoderWatchTable, a_lie_about_the_way_must_last_and_be_one) {
    Told t;
    t.spans(4, {4, 4});
    CHECK_FALSE(t.span({-4, 4}, {}));  // one span alone
    CHECK_FALSE(t.span({4, 4}, {}));
    Told other;
    other.spans(70, {4, 4});
    CHECK_FALSE(other.span({-4, 4}, {}));
    CHECK_FALSE(other.span({4, -4}, {}));
    CHECK(other.span({4, -4}, {}));
    // Five spans' ends are to be known, none from before a rest.
    Told anew;
    anew.spans(6, {4, -4});
    anew.watch.rest(anew.told());
    anew.spans(10, {-4, 4});
    anew.watch.rest(anew.told());
    anew.spans(3, {4, 4});
    CHECK_FALSE(anew.span({-4, 4}, {}));
    CHECK(anew.span({-4, 4}, {}));
    // where nobody looks, the span is longer
    Told slow;
    slow.spans(5, {4, 4});
    CHECK_FALSE(slow.span({-4, 4}, {}, 30));
    CHECK(slow.span({-4, 4}, {}, 30));
}

// Which is by the plant that is driven: by K7 as well as by K8 b / 2.
TEST(EncoderWatchTable, a_mirror_image_must_be_more_than_full_torque_makes) {
    for (const double k7 : {0.5, 1.0, 2.0}) {
        for (const double k8 : {2.0, 4.0, 12.0}) {
            const double least = 2.5 * std::max(k7, k8 / 4);
            for (const double speed : {least, 0.999 * least}) {
                Told t;
                t.plant.dynamics = {0, 0, k7, k8};
                t.settings.creeping_rad_per_s = 0;
                t.watch.configure(t.settings);
                t.spans(6, {speed, speed});
                CHECK_FALSE(t.span({-speed, speed}, {}));
                LONGS_EQUAL_TEXT(speed == least, t.span({-speed, speed}, {}), std::to_string(speed).c_str());
            }
        }
    }
}

// What is expected is what was, and what torque and inertia make of it.
TEST(EncoderWatchTable, a_wheel_that_is_accelerated_from_rest_shows_the_wrong_way) {
    struct Row {
        double gain;  // in each span
        int spans;
    };
    // three spans' gain is the last one's, and 2.5 is the least; then ten spans of 8 cycles against it
    for (const Row& row : {Row{0.875, 4}, Row{0.8125, 10}, Row{0.375, 10}, Row{0.374, 0}}) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                Told t;
                t.spans(6, {});
                int seen = 0;
                for (int n = 1; n <= 14 && seen == 0; ++n) {
                    const double gain = sign * row.gain;
                    if (t.gains(one(right, -gain, 0.5 * gain), one(right, gain, 0.5 * gain))) seen = n;
                }
                LONGS_EQUAL_TEXT(row.spans, seen, name(right, sign * row.gain).c_str());
            }
        }
    }
}

// A leap to a share of itself, and then gains of such a share of what is expected. Full torque makes 0.625.
TEST(EncoderWatchTable, a_speed_that_leaps_to_a_share_and_gains_that_share_is_not_believed) {
    struct Row {
        const char* what;
        double was = 16, share = 0.5, gains_share = 0.5, expected = 0.63, other_leaps = 0, noise = 0;
        int before = 70;
        // one in which it ends, three to settle, two until 0.315 a span are 0.625, three more; seven where
        // it gains otherwise by more than a quarter of what a push would
        int seen = 9;
    };
    const Row rows[] = {
        {.what = "half of the counts"},
        {.what = "a push", .gains_share = 1, .seen = 0},
        {.what = "gains nothing", .gains_share = 0, .seen = 0},
        {.what = "no gain is expected", .expected = 0, .seen = 0},
        {.what = "slows down", .expected = -0.63},
        // by then the share is 0.52 or 0.47
        {.what = "half more", .gains_share = 0.765, .seen = 14},
        {.what = "more than that", .gains_share = 0.775, .seen = 0},
        {.what = "half less", .gains_share = 0.2, .seen = 13},
        {.what = "a tenth more", .gains_share = 0.55, .seen = 10},
        {.what = "two fifths more", .gains_share = 0.7, .seen = 14},
        {.what = "less than that", .gains_share = 0.18, .seen = 0},
        {.what = "a quarter of the counts", .share = 0.25, .gains_share = 0.25},  // 0.47 a span
        {.what = "a fifth", .was = 32, .share = 0.201, .gains_share = 0.2},
        {.what = "less than a fifth", .was = 32, .share = 0.199, .gains_share = 0.2, .seen = 0},
        {.what = "turns round", .was = 32, .share = -0.4, .gains_share = -0.4, .seen = 0},
        {.what = "four fifths", .was = 32, .share = 0.799, .gains_share = 0.8, .seen = 12},  // 0.126 a span
        {.what = "more than four fifths", .was = 32, .share = 0.801, .gains_share = 0.8, .seen = 0},
        {.what = "twice", .was = 32, .share = 2, .gains_share = 2, .seen = 0},
        {.what = "the other wheel leaps too", .other_leaps = 0.07, .seen = 0},
        {.what = "the other wheel leaps back", .other_leaps = -0.07, .seen = 0},
        {.what = "the other wheel hardly leaps", .other_leaps = 0.05},
        // five spans of full torque make 3.125
        {.what = "a leap of 2.8 and 0.315", .was = 5.6, .seen = 0},
        {.what = "a leap of 2.825 and 0.315", .was = 5.65},
        {.what = "known 64 spans after", .expected = 0.022, .seen = 64},
        {.what = "not by then", .expected = 0.0217, .seen = 0},
        // both wheels' by turns: 0.315 a span are more than 0.5 of the root of the spans three spans later
        {.what = "noise", .noise = 0.1, .seen = 12},
    };
    for (const Row& row : rows) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                const auto as = [&](double its, double others) {
                    return one(right, sign * its, sign * others);
                };
                Told t;
                for (int n = 0; n < row.before; ++n) {
                    const double by = n % 2 == 0 ? 0 : row.noise;
                    CHECK_FALSE(t.span(as(row.was + by, row.was + by), {}));
                }
                const double leap = row.was * (1 - row.share);
                CHECK_FALSE_TEXT(t.gains(as(-leap, -row.other_leaps * leap), {}), row.what);
                int seen = 0;
                for (int n = 1; n <= 70 && seen == 0; ++n) {
                    const double by = n % 2 == 0 ? -row.noise : row.noise;
                    if (t.gains(as(row.gains_share * row.expected + by, by), as(row.expected, 0))) seen = n;
                }
                LONGS_EQUAL_TEXT(row.seen, seen, row.what);
            }
        }
    }
}

TEST(EncoderWatchTable,
     a_leap_is_seen_as_a_whole_and_forgotten_when_nothing_drives_or_a_gain_contradicts_it) {
    const auto seen_after = [](Told& t) {
        for (int n = 1; n <= 70; ++n)
            if (t.gains({0.315, 0}, {0.63, 0})) return n;
        return 0;
    };
    // A slow observer's leap of 5.6 by spans in which 0.93 is more than full torque makes.
    Told slow;
    slow.spans(70, {11.2, 11.2});
    for (int n = 0; n < 6; ++n) CHECK_FALSE(slow.gains({-5.6 / 6, 0}, {}));
    LONGS_EQUAL(10, seen_after(slow));

    Told rested;
    rested.spans(70, {16, 16});
    CHECK_FALSE(rested.gains({-8, 0}, {}));
    for (int n = 0; n < 5; ++n) CHECK_FALSE(rested.gains({0.315, 0}, {0.63, 0}));
    rested.watch.rest(rested.told());
    for (int n = 0; n < 5; ++n) CHECK_FALSE(rested.gains({}, {}));
    LONGS_EQUAL(0, seen_after(rested));

    // What was before a rest is no leap's beginning.
    Told anew;
    anew.spans(70, {16, 16});
    anew.watch.rest(anew.told());
    anew.spans(5, {16, 16});
    CHECK_FALSE(anew.gains({-8, 0}, {}));
    LONGS_EQUAL(0, seen_after(anew));

    // Gains as a push's, and then as much less.
    Told pushed;
    pushed.spans(70, {16, 16});
    CHECK_FALSE(pushed.gains({-8, 0}, {}));
    for (int n = 0; n < 4; ++n) CHECK_FALSE(pushed.gains({0.315, 0}, {0.63, 0}));
    for (int n = 0; n < 2; ++n) CHECK_FALSE(pushed.gains({0.63, 0}, {0.63, 0}));
    for (int n = 0; n < 2; ++n) CHECK_FALSE(pushed.gains({0, 0}, {0.63, 0}));
    LONGS_EQUAL(0, seen_after(pushed));
}

// In a span: a, against what is expected; g, as expected; n, neither; o, the other wheel is not as expected;
// t, too little.
TEST(EncoderWatchTable, gains_of_speed_against_what_is_expected_add_up_to_80_cycles) {
    struct Row {
        const char* spans;
        double share;  // of what is expected, so much
        bool lies;
    };
    const Row rows[] = {
        {"aaaaaaaaaa", 1, true},       {"aaaaaaaaa", 1, false},     {"aaaaaaaaata", 1, true},
        {"aaaaanaaaaa", 1, true},      {"aaaaaoaaaa", 1, false},    {"aaaaagaaaaaaaaa", 1, false},
        {"aaaaagaaaaaaaaaa", 1, true}, {"aaaaaaaaaa", 0.5, true},   {"aaaaaaaaaa", 0.49, false},
        {"aaaaaaaaaa", 1.5, true},     {"aaaaaaaaaa", 1.51, false}, {"aaaaahaaaaaaaaa", 1, false},
        {"aaaaaiaaaaa", 1, true},      {"rrrrrrrrrr", 1, true},     {"ssssssssss", 1, false},
    };
    for (const Row& row : rows) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                const double e = sign * 0.5;
                Told t;
                t.spans(70, {});
                bool lies = false;
                for (const char* c = row.spans; *c != 0; ++c) {
                    double told = -row.share * e, other = 0, expected = e;
                    if (*c == 'g') told = e;
                    if (*c == 'h') told = 0.5 * e;
                    if (*c == 'i') told = 0.49 * e;
                    if (*c == 'n') told = 0;
                    if (*c == 'o') other = e;
                    if (*c == 'r') other = 0.5 * e;
                    if (*c == 's') other = 0.51 * e;
                    if (*c == 't') told = expected = 0;
                    lies = t.gains(one(right, told, other), one(right, expected, 0));
                    CHECK(!lies || c[1] == 0);
                }
                LONGS_EQUAL_TEXT(row.lies, lies, (row.spans + name(right, row.share)).c_str());
            }
        }
    }
    // 79 cycles are too few after one that was right.
    Told few;
    few.spans(6, {});
    CHECK_FALSE(few.gains({0.5, 0}, {0.5, 0}));
    for (int n = 1; n <= 8; ++n) CHECK_FALSE(few.gains({-0.5, 0}, {0.5, 0}));
    CHECK_FALSE(few.gains({-0.5, 0}, {0.5, 0}, 15));
    CHECK(few.gains({-0.5, 0}, {0.5, 0}));
    Told slow;
    slow.spans(6, {});
    for (int n = 1; n <= 4; ++n) LONGS_EQUAL(n == 4, slow.gains({-0.5, 0}, {0.5, 0}, 20));
    Told forgets;
    forgets.spans(6, {});
    for (int n = 1; n < 10; ++n) CHECK_FALSE(forgets.gains({-0.5, 0}, {0.5, 0}));
    forgets.watch.rest(forgets.told());
    forgets.spans(6, forgets.speed_rad_per_s);
    for (int n = 1; n <= 10; ++n) LONGS_EQUAL(n == 10, forgets.gains({-0.5, 0}, {0.5, 0}));
}

// Over four spans, against a quarter of what full torque makes of a turn in them, or 0.6 of what it makes of
// a speed, as where the drives are mirror images too; sixteen times in a row. In an identification, whose
// torques are gentle, it says nothing.
TEST(EncoderWatchTable, what_long_gains_against_its_torques_is_of_exchanged_encoders) {
    struct Row {
        double gain, share;  // gain: of the least in a span
        bool lies;
    };
    const Row rows[] = {{1.1, 1, true},     {1.1, 0.51, true}, {1.1, 0.49, false}, {1.1, 1.49, true},
                        {1.1, 1.51, false}, {1.0003, 1, true}, {0.9997, 1, false}, {1.1, -1, false}};
    for (const bool turns : {true, false}) {
        for (const int sign : {1, -1}) {
            const double least = sign * (turns ? 0.15625 : 0.375);
            const auto against = [&](Told& t, const Row& row) {
                const auto both = [turns](double gain) {
                    return WheelPair<double>{turns ? -gain : gain, gain};
                };
                return t.gains(both(-row.share * row.gain * least), both(row.gain * least));
            };
            const auto after = [&](Told& t, const Row& row) {
                for (int n = 1; n <= 30; ++n)
                    if (against(t, row)) return n;
                return 0;
            };
            for (const Row& row : rows) {
                Told t;
                t.spans(70, {});
                LONGS_EQUAL_TEXT(row.lies ? 19 : 0, after(t, row), std::to_string(row.gain).c_str());
                Told again;
                again.spans(70, {});
                for (int n = 1; n <= 18; ++n) CHECK_FALSE(against(again, row));
                again.spans(5, again.speed_rad_per_s);
                LONGS_EQUAL(row.lies ? 19 : 0, after(again, row));
                EncoderWatchSettings identifying = kSettings;
                identifying.known_friction_Nm = 1e3;
                Told gentle(identifying);
                gentle.spans(70, {});
                LONGS_EQUAL(0, after(gentle, row));
            }
            Told forgets;
            forgets.spans(70, {});
            for (int n = 1; n <= 18; ++n) CHECK_FALSE(against(forgets, rows[0]));
            forgets.watch.rest(forgets.told());
            for (int n = 1; n <= 20; ++n) LONGS_EQUAL(n == 20, against(forgets, rows[0]));
            // One span that is as expected begins it anew, though of four the others are enough.
            const Row more{1.45, 1, true};
            Told once;
            once.spans(70, {});
            for (int n = 1; n <= 17; ++n) CHECK_FALSE(against(once, more));
            once.spans(1, once.speed_rad_per_s);
            for (int n = 1; n <= 16; ++n) LONGS_EQUAL(n == 16, against(once, more));
        }
    }
    // Where nobody knows K5 yet a body that turns may gain so much by itself.
    for (const double turning : {0.0, 12.0}) {
        Told t;
        t.plant.dynamics.k5_m = t.plant.dynamics.k6_per_m = 0;
        t.spans(70, {-turning, turning});
        bool lies = false;
        for (int n = 1; n <= 19 && !lies; ++n) lies = t.gains({0.2, -0.2}, {-0.2, 0.2});
        CHECK_EQUAL(turning == 0, lies);
    }
}

// Where it creeps or is noise, a speed says nothing. Noise is what the better of two wheels gains otherwise
// than expected in a span, averaged: over all that were, then with the weight of 64.
TEST(EncoderWatchTable, a_mirror_image_must_be_more_than_creeping_and_noise) {
    EncoderWatchSettings creeps = kSettings;
    creeps.creeping_rad_per_s = 4.5;
    for (const double speed : {4.5, 4.49}) {
        Told t(creeps);
        t.spans(6, {speed, speed});
        t.span({-speed, speed}, {});
        LONGS_EQUAL(speed == 4.5, t.span({-speed, speed}, {}));
    }
    struct Row {
        int quiet, noisy;
        double weight;  // of the noise in the average
    };
    for (const Row& row : {Row{0, 10, 1}, Row{20, 40, 40.0 / 60}, Row{64, 50, 1 - std::pow(63.0 / 64, 50)}}) {
        for (const double less : {1e-6, -1e-6}) {
            Told t;
            const double speed = 64, noise = speed / (5 * row.weight) * (1 - less);
            t.spans(4 + row.quiet, {speed, speed});
            bool lies = false;
            for (int n = 1; n <= row.noisy; ++n) {
                CHECK_FALSE(lies);
                const double now = speed + (n % 2) * noise;  // four spans before the last: without
                lies = t.span({n > row.noisy - 2 ? -now : now, now}, {});
            }
            LONGS_EQUAL_TEXT(less > 0, lies, std::to_string(row.noisy).c_str());
        }
    }
}

// Of 64 spans of noise, it decays by a 64th in each. A push's gain counts less what friction at the other
// wheel may make of it, a third here.
TEST(EncoderWatchTable, gains_of_speed_must_be_more_than_noise) {
    for (const bool by_pushes : {false, true}) {
        for (const double less : {1e-6, -1e-6}) {
            EncoderWatchSettings settings = kSettings;
            if (by_pushes) settings.known_friction_Nm = 0.5;
            Told t(settings);
            if (by_pushes) t.expects.dynamics = {0, 0, kK7 / 2, kK8 / 2};
            const double gain = by_pushes ? 0.03125 : 0.5;
            const double noise = gain / 2 / std::pow(63.0 / 64, 5) * (1 - less);
            t.spans(4, {});
            for (int n = 1; n <= 64; ++n) CHECK_FALSE(t.span({(n % 2) * noise, (n % 2) * noise}, {}));
            int seen = 0;
            for (int n = 1; n <= 20 && seen == 0; ++n) {
                const bool lies = by_pushes ? t.pushed({n * -0.09375, n * 0.046875}, {1.5, 1.5})
                                            : t.gains({-0.5, 0}, {0.5, 0});
                if (lies) seen = n;
            }
            LONGS_EQUAL(5 + (by_pushes ? 4 : 9) + (less < 0), seen);
        }
    }
}

// A body that turns moves its wheels by K5 and K6.
TEST(EncoderWatchTable, where_nobody_knows_K5_gains_of_speed_in_a_turn_tell_nothing) {
    for (const bool known : {true, false}) {
        for (const bool turns : {true, false}) {
            Told t;
            t.plant.dynamics.k5_m = known ? 1e-30 : 0;
            t.speed_rad_per_s = turns ? WheelPair<double>{-20, 20} : WheelPair<double>{0, 0};
            t.spans(5, t.speed_rad_per_s);
            int seen = 0;
            for (int n = 1; n <= 14 && seen == 0; ++n)
                if (t.gains({-0.5, 0}, {0.5, 0})) seen = n;
            CHECK_EQUAL(known || !turns, seen > 0);
        }
    }
}

// Such a body adds at most 8 ms omega (b / 2 omega + v) over the smaller radius, here 1 rad/s in a span: half
// of the gain that tells something.
TEST(EncoderWatchTable, where_nobody_knows_K5_gains_must_be_more_than_any_body_makes) {
    for (const double gain : {1.97, 2.03}) {
        Told t;
        t.plant.dynamics.k5_m = 0;
        t.speed_rad_per_s = {-15 + gain, 12.5};  // after the gain: v 0.3125 m/s, omega 5 rad/s
        t.spans(5, t.speed_rad_per_s);
        int seen = 0;
        for (int n = 1; n <= 14 && seen == 0; ++n) {
            if (t.gains({-gain, 0}, {gain, 0})) seen = n;
            if (seen == 0) CHECK_FALSE(t.gains({gain, 0}, {0, 0}));
        }
        LONGS_EQUAL(gain > 2 ? 10 : 0, seen);
    }
}

// Where friction is known: at both wheels a push in a span of no less than what friction of both can make of
// its speed, 1 Nm forward or 0.5 Nm turning here, and a quarter of what such torques alone would give. A
// span's letters: p, pushed; w, too weak in the first cycle, or v, in the last one; g, this wheel goes with
// the push; n, it does neither.
TEST(EncoderWatchTable,
     a_wheel_that_goes_against_a_push_for_40_cycles_while_the_other_goes_with_it_is_not_believed) {
    struct Row {
        const char* spans;
        double torque_Nm;
        bool turning;
        double share, others;  // of what the push gives
        bool lies;
    };
    const Row rows[] = {
        {"ppppp", 1.0625, false, -0.25, 0.25, true},    {"pppp", 1.0625, false, -0.25, 0.25, false},
        {"pppppp", 0.9375, false, -0.25, 0.25, false},  {"pppppp", 1.0625, false, -0.24, 0.25, false},
        {"pppppp", 1.0625, false, -0.25, 0.24, false},  {"pppppp", 1.0625, false, -0.25, -0.25, false},
        {"ppppp", 0.75, true, -0.25, -0.25, true},      {"ppppp", 0.75, true, -0.25, 0.25, true},
        {"pppppp", 0.75, true, -0.25, 0.24, false},     {"pppppp", 0.75, true, -0.25, -0.24, false},
        {"pppppp", 0.75, true, 0.25, 0.25, false},      {"wppppp", 1.0625, false, -0.25, 0.25, true},
        {"vppppp", 1.0625, false, -0.25, 0.25, true},   {"ppwppp", 1.0625, false, -0.25, 0.25, true},
        {"ppvppp", 1.0625, false, -0.25, 0.25, true},   {"ppwpp", 1.0625, false, -0.25, 0.25, false},
        {"ppvpp", 1.0625, false, -0.25, 0.25, false},   {"ppgpppp", 1.0625, false, -0.25, 0.25, false},
        {"ppgppppp", 1.0625, false, -0.25, 0.25, true}, {"ppnppp", 1.0625, false, -0.25, 0.25, true},
        {"ppppp", 0.5625, true, -0.25, 0.25, true},     {"pppppp", 0.4375, true, -0.25, 0.25, false},
    };
    EncoderWatchSettings settings = kSettings;
    settings.known_friction_Nm = 0.5;
    for (const Row& row : rows) {
        for (const bool right : {false, true}) {
            for (const int sign : {1, -1}) {
                const double torque_Nm = sign * row.torque_Nm;
                const WheelPair<double> acting = one(right, torque_Nm, row.turning ? -torque_Nm : torque_Nm);
                const double span_s = 8 * kElapsed_s;
                const WheelPair<double> push{span_s * (24 * acting.left - 8 * acting.right),
                                             span_s * (12 * acting.right - 4 * acting.left)};
                Told t(settings);
                const double expected = std::abs(row.others);
                t.expects.dynamics = {0, 0, expected * kK7, expected * kK8};
                t.spans(70, {});
                bool lies = false;
                for (const char* c = row.spans; *c != 0; ++c) {
                    const double share = *c == 'g' ? 0.25 : *c == 'n' ? 0 : row.share;
                    const WheelPair<double> ends{
                        t.speed_rad_per_s.left + (right ? row.others : share) * push.left,
                        t.speed_rad_per_s.right + (right ? share : row.others) * push.right};
                    const WheelPair<double> weak{acting.left / 2, acting.right / 2};
                    if (*c == 'w' || *c == 'v') {
                        for (int i = 1; i <= 8; ++i)
                            CHECK_FALSE(t.cycle({ends, i == (*c == 'w' ? 1 : 8) ? weak : acting, {}, {}}));
                        t.speed_rad_per_s = ends;
                    } else {
                        lies = t.pushed(ends, acting);
                    }
                    CHECK(!lies || c[1] == 0);
                }
                LONGS_EQUAL_TEXT(row.lies, lies, (row.spans + name(right, torque_Nm)).c_str());
            }
        }
    }
    // What was counted is no more where friction is not known.
    Told unknown(settings);
    unknown.expects.dynamics = {0, 0, kK7 / 4, kK8 / 4};
    unknown.spans(6, {});
    for (int n = 1; n <= 4; ++n) CHECK_FALSE(unknown.pushed({n * -0.03125, n * 0.015625}, {1, 1}));
    unknown.watch.configure(kSettings);
    for (int n = 5; n <= 9; ++n) CHECK_FALSE(unknown.pushed({n * -0.03125, n * 0.015625}, {1, 1}));
    // 39 cycles are too few after one that was right.
    Told few(settings);
    few.expects.dynamics = {0, 0, kK7 / 4, kK8 / 4};
    few.spans(6, {});
    const auto lies = [&](double left, int cycles) {
        const double push = 1.0625 * kElapsed_s * cycles;
        return few.pushed({few.speed_rad_per_s.left + left * 16 * push, few.speed_rad_per_s.right + 2 * push},
                          {1.0625, 1.0625}, cycles);
    };
    CHECK_FALSE(lies(0.25, 8));
    for (int n = 1; n <= 3; ++n) CHECK_FALSE(lies(-0.25, 8));
    CHECK_FALSE(lies(-0.25, 15));
    CHECK(lies(-0.25, 8));
}

// A body that turns moves its wheels too, whichever wheel tells the truth: that must be less than half of
// what the push gives beyond what friction may, 0.09375 - 0.0625 rad/s.
TEST(EncoderWatchTable, a_push_says_nothing_where_a_turning_body_moves_the_wheels_as_much) {
    EncoderWatchSettings settings = kSettings;
    settings.known_friction_Nm = 0.5;
    for (const double left : {6.0, -6.0}) {
        for (const double by_k5 : {1.0, 0.0, 0.5}) {
            for (const double scale : {0.93, 1.07}) {
                const auto rim = [&](double of_left, double k5, double k6) {
                    const double v = (0.125 * 8 + 0.0625 * of_left) / 2;
                    const double omega = (0.125 * 8 - 0.0625 * of_left) / kTrack_m;
                    return (std::abs(k5 * omega * omega) + std::abs(k6 * v * omega) * kTrack_m / 2) / 0.0625 *
                           8 * kElapsed_s;
                };
                const auto most = [&](double k5, double k6) {
                    return std::max(rim(6, k5, k6), rim(-6, k5, k6));
                };
                const double k6 = 3, half = 0.03125 / 2 * scale;
                Told t(settings);
                t.expects.dynamics = {0, 0, kK7 / 4, kK8 / 4};
                const double as_was = most(by_k5, (by_k5 - 1) * k6);
                t.plant.dynamics.k5_m = by_k5 * half / as_was;
                t.plant.dynamics.k6_per_m = (by_k5 - 1) * k6 * half / as_was;
                t.spans(70, {left, 8});
                bool lies = false;
                for (int n = 1; n <= 6 && !lies; ++n)
                    lies = t.pushed({left - n * 0.046875, 8 + n * 0.0234375}, {1.5, 1.5});
                LONGS_EQUAL_TEXT(scale < 1, lies, std::to_string(by_k5).c_str());
            }
        }
    }
}

// Where nobody knows K5 and K6 the mass may lie half a track away from the axle. Drawn robots whose files
// list their friction were stopped in their identification so: the push, 0.094 rad/s in a span beyond what
// friction may, was less than what turned them in a bend.
TEST(EncoderWatchTable, a_push_says_nothing_in_a_bend_of_a_body_that_nobody_knows) {
    EncoderWatchSettings settings = kSettings;
    settings.known_friction_Nm = 0.5;
    for (const double scale : {0.75, 1.07}) {  // grows by a fifth while it is pushed
        // 8 cycles of omega (b / 2 omega + v) over the smaller wheel, as large as half of the push
        const double omega = std::sqrt(scale * 0.03125 / 2 * 0.0625 / (8 * kElapsed_s * kTrack_m / 2));
        const double rim = omega * kTrack_m / 2;
        Told t(settings);
        t.expects.dynamics = {0, 0, kK7 / 4, kK8 / 4};
        t.plant.dynamics.k5_m = t.plant.dynamics.k6_per_m = 0;
        const WheelPair<double> speed{-rim / 0.0625, rim / 0.125};
        t.spans(70, speed);
        bool lies = false;
        for (int n = 1; n <= 6 && !lies; ++n)
            lies = t.pushed({speed.left - n * 0.046875, speed.right + n * 0.0234375}, {1.5, 1.5});
        LONGS_EQUAL(scale < 1, lies);
    }
}

// Measured on a drawn robot in its identification: the one wheel was pushed hard, the other one gently, and
// mass and inertia let the hard push and both frictions turn the gently pushed one back.
TEST(EncoderWatchTable, a_wheel_that_friction_and_the_other_ones_push_turn_back_is_no_liar) {
    EncoderWatchSettings settings = kSettings;
    settings.known_friction_Nm = 0.5;
    for (const bool right : {false, true}) {
        for (const double other_Nm : {1.5, 3.0}) {
            Told t(settings);
            t.plant.dynamics.k7_per_kg_m = 2 * kK7;
            t.plant.dynamics.k8_per_kg_m2 = 2 * kK8;
            t.expects = t.plant;
            t.spans(70, {});
            // in a span of 1 / 128 s: three times by its own torque what the other one's takes away
            const auto push = [](bool of_right, double own, double other) {
                return of(kOwn_per_Nm, of_right) * 2 * (own - other / 3) / 128;
            };
            const double hard = push(!right, other_Nm, 1.5), gently = push(right, 1.5, other_Nm);
            bool lies = false;
            for (int n = 1; n <= 6 && !lies; ++n)
                lies = t.pushed(one(right, n * -0.3 * gently, n * hard), one(right, 1.5, other_Nm));
            CHECK_EQUAL(other_Nm == 1.5, lies);
        }
    }
}
