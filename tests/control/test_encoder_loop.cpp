// A drive's encoder loop is written here as drives compute it, on angles; its reports are what the estimator
// of its lag gets, and what must lead back to the angles.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "firmware/control/encoder_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright::control;

namespace {

constexpr double kPeriod_s = 1.0 / 8000, kCycle_s = 0.001;
constexpr int kPeriods = 8;  // in a cycle

struct DriveLoop {
    double bandwidth_rad_per_s;
    double position_rad = 0, speed_rad_per_s = 0;

    void take(double angle_rad) {
        position_rad += kPeriod_s * speed_rad_per_s;
        const double off = angle_rad - position_rad;
        position_rad += 2 * bandwidth_rad_per_s * kPeriod_s * off;
        speed_rad_per_s += bandwidth_rad_per_s * bandwidth_rad_per_s * kPeriod_s * off;
    }
};

// An acceleration that jumps every 20 cycles, as the excitation's does.
struct Wheel {
    std::mt19937 random{7};
    double rate_rad_per_s2 = 0, angle_rad = 0, before_rad = 0;
    int cycles = 0;

    void begin_cycle() {
        if (cycles++ % 20 == 0) rate_rad_per_s2 = std::uniform_real_distribution(-90.0, 90.0)(random);
    }
    void step() {
        const double next = 2 * angle_rad - before_rad + kPeriod_s * kPeriod_s * rate_rad_per_s2;
        before_rad = angle_rad;
        angle_rad = next;
    }
};

// Reports of a drive that computes its loop seven to nine times between them.
struct Reports {
    Wheel wheel;
    DriveLoop loop;
    EncoderBehindLoop behind;
    double mean_rad = 0;  // of the angles since the last report
    std::int64_t time_ns = 5'000'000'000;
    bool stands = false;

    explicit Reports(double bandwidth_rad_per_s) : loop{bandwidth_rad_per_s} {
        behind.configure(1 / bandwidth_rad_per_s, kPeriod_s, kCycle_s);
    }
    EncoderSample next(int periods = kPeriods) {
        mean_rad = 0;
        if (!stands) wheel.begin_cycle();
        for (int i = 0; i < periods; ++i) {
            if (!stands) wheel.step();
            loop.take(wheel.angle_rad);
            mean_rad += wheel.angle_rad / periods;
        }
        time_ns += 1'000'000;
        return {loop.position_rad, loop.speed_rad_per_s, time_ns};
    }
};

}  // namespace

TEST_GROUP(EncoderLoop){};

TEST(EncoderLoop, its_lag_is_read_from_reports_of_a_noisy_encoder_with_some_missing) {
    for (const double bandwidth : {40.0, 60.0, 100.0, 330.0, 1000.0, 2100.0}) {
        Wheel wheel;
        DriveLoop loop{bandwidth};
        std::normal_distribution noise(0.0, 3e-4);
        EncoderLoopLag lag;
        DOUBLES_EQUAL(0, lag.lag_s(kPeriod_s, kCycle_s), 0);
        for (int cycle = 1; cycle <= 20'000; ++cycle) {
            wheel.begin_cycle();
            for (int i = 0; i < kPeriods; ++i) {
                wheel.step();
                loop.take(wheel.angle_rad + noise(wheel.random));
            }
            if (cycle % 41 == 0) continue;
            const auto time_ns = std::int64_t{1'000'000} * cycle;
            for (int seen = 0; seen < 2; ++seen)  // counts once
                lag.take({loop.position_rad, loop.speed_rad_per_s, time_ns}, kCycle_s);
        }
        DOUBLES_EQUAL(bandwidth == 40 ? 0.8 : 1.0, bandwidth * lag.lag_s(kPeriod_s, kCycle_s), 0.01);
    }
}

TEST(EncoderLoop, a_lag_that_the_reports_do_not_tell_for_sure_is_the_one_that_was_known) {
    // Where positions and speeds have nothing to do with each other no lag is told, at first none anyway.
    for (const double noise_rad : {0.0, 1e-5, 3e-3}) {
        Reports reports(200);
        std::normal_distribution noise(0.0, 1.0);
        EncoderLoopLag lag;
        for (int cycle = 1; cycle <= 1000; ++cycle) {
            EncoderSample reported = reports.next();
            reported.position_rad += noise_rad * noise(reports.wheel.random);
            lag.take(reported, kCycle_s);
            // the first report begins the first of five spans of 20 ms
            const bool known = cycle > 5 * 20 && noise_rad < 1e-3;
            if (cycle != 101 && cycle < 900) continue;
            DOUBLES_EQUAL(known ? 0.005 : 0.123, lag.lag_s(kPeriod_s, kCycle_s, 0.123), 5e-5);
        }
    }
    EncoderLoopLag still;
    for (int cycle = 1; cycle <= 1000; ++cycle)
        still.take({1.5, 0, std::int64_t{1'000'000} * cycle}, kCycle_s);
    DOUBLES_EQUAL(0.123, still.lag_s(kPeriod_s, kCycle_s, 0.123), 0);
}

// Speeds that go to and fro between the ends of eight spans, and positions that are off by as much to either
// side of what a lag makes of them.
TEST(EncoderLoop, a_lag_is_known_with_a_standard_error_of_a_fiftieth_of_it_and_of_a_period) {
    constexpr int kSpan = 20, kSpans = 8;
    constexpr double kOff[] = {1, 1, -1, -1};
    for (const double lag_s : {0.005, 0.0005}) {
        for (const double share : {0.999, 1.001}) {
            const double off_rad = share * 2 * std::max(lag_s, kCycle_s) / 50 * std::sqrt(kSpans - 1.0);
            EncoderLoopLag lag;
            double position_rad = 0, speed = 0;
            std::int64_t time_ns = 7'000'000;
            lag.take({position_rad, speed, time_ns}, kCycle_s);
            for (int span = 0; span < kSpans; ++span) {
                const double gains = span % 2 == 0 ? 1 : -1;
                const double ahead_rad = 2 * lag_s * gains + off_rad * kOff[span % 4];
                for (int i = 0; i < kSpan; ++i) {
                    position_rad += kCycle_s * (speed + gains / kSpan / 2) + ahead_rad / kSpan;
                    speed += gains / kSpan;
                    time_ns += 1'000'000;
                    lag.take({position_rad, speed, time_ns}, kCycle_s);
                }
            }
            DOUBLES_EQUAL(share < 1 ? lag_s : 0.123, lag.lag_s(0, kCycle_s, 0.123), 1e-9);
        }
    }
}

TEST(EncoderLoop, of_two_reports_in_a_cycle_one_may_be_missed_but_not_three_in_a_row) {
    for (const int apart : {1, 2, 3, 4}) {
        Reports reports(200);
        EncoderLoopLag lag;
        for (int cycle = 1; cycle <= 2000; ++cycle) {
            const EncoderSample reported = reports.next();
            const bool silent = cycle > 700 && cycle < 1200;  // begins anew
            if (cycle % apart == 0 && !silent) lag.take(reported, kCycle_s);
        }
        DOUBLES_EQUAL(apart < 3 ? 0.005 : 0.123, lag.lag_s(kPeriod_s, kCycle_s, 0.123), 1e-4);
    }
}

TEST(EncoderLoop, an_angle_is_what_its_formula_says) {
    constexpr double kCount_rad = 0.15;
    EncoderBehindLoop behind;
    behind.configure(0.01, 1e-4, kCycle_s, kCount_rad);
    constexpr double kOff_s2 = 0.01 * (0.01 - 2e-4), kAhead_s = 0.02 - 0.5e-4;
    EncoderBehindLoop later = behind;
    DOUBLES_EQUAL(2, later.sample({2, 6, 700'000'000}).position_rad, 1e-12);  // nothing came before
    double last_speed = 0, last_rad = 0;
    const auto check = [&](double position_rad, double speed, std::int64_t time_ns, double mean_rad,
                           double off_rad) {
        const bool no_count = speed == last_speed && std::abs(position_rad - last_rad) <= 2 * kCount_rad;
        last_speed = speed;
        last_rad = position_rad;
        const EncoderSample angle = behind.sample({position_rad, speed, time_ns});
        DOUBLES_EQUAL(mean_rad + off_rad, angle.position_rad, 1e-12);
        const double off = std::abs(off_rad);
        DOUBLES_EQUAL(no_count ? std::numeric_limits<double>::infinity()
                               : off / 30 + (off > kCount_rad ? kCount_rad : 0),
                      behind.unsure_rad(), 1e-12);
    };
    double at_rad = 2, speed = 0;
    std::int64_t at_ns = 1;
    check(at_rad, speed, at_ns, 2, 0);
    // So much speed is gained in this time, by the way, in so many periods of the reports.
    const auto next = [&](double gained, int reports, double by_way_s, double passed_s) {
        const double mean_speed = speed + gained / 2;
        const double way_rad = kAhead_s * gained + mean_speed * by_way_s;
        speed += gained;
        at_rad += way_rad;
        at_ns += reports * 1'000'000;
        const double back_rad =
            reports == 1 ? way_rad / 2 : kCycle_s / 2 * (speed + kAhead_s * gained / passed_s);
        check(at_rad, speed, at_ns, at_rad - back_rad, kOff_s2 * gained / passed_s);
    };
    next(2, 1, 1.05e-3, 1.05e-3);  // a mean speed of 1
    next(-4, 1, 1.05e-3, 1e-3);    // of 0, which tells no time
    next(7, 1, 1.15e-3, 1.1e-3);   // not more than a period of the loop longer,
    next(7, 1, 0.85e-3, 0.9e-3);   // or shorter
    next(0, 1, 1e-3, 1e-3);        // no count has come: the loop has gone on by itself
    for (const int reports : {2, 3, 4}) next(-3, reports, 1e-3 * reports, 1e-3 * reports);
    CHECK(behind.unsure_rad() > 0);
    later = behind;
    later.configure(0.01, 1e-4, kCycle_s);
    DOUBLES_EQUAL(0, later.unsure_rad(), 0);
    const double told_rad = behind.sample({at_rad, speed, at_ns}).position_rad;
    DOUBLES_EQUAL(told_rad, behind.sample({at_rad + 1, speed, at_ns + 300'000}).position_rad,
                  0);                                                     // between two
    check(at_rad + 1, speed, at_ns + 5'000'000, at_rad + 1, 0);           // too late to follow
    check(at_rad, speed, at_ns, at_rad, 0);                               // the clock has gone back
    DOUBLES_EQUAL(at_rad, behind.sample({0, 0, 0}).position_rad, 1e-12);  // nothing was told
}

// A wheel at 10 rad/s that is reported each 10 ms, and one report more at any time between two: what is not
// within a tenth of a period of the beat is left out, and the regular ones keep theirs.
TEST(EncoderLoop, what_is_asked_for_off_the_beat_is_left_out_and_the_beat_goes_on) {
    constexpr std::int64_t kTenth_ns = 1'000'000, kPeriod_ns = 10 * kTenth_ns;
    for (const std::int64_t asked_ns : {3, 8, 12, 40, 85, 88}) {  // tenths of a millisecond after a report
        EncoderBehindLoop behind;
        behind.configure(0.01, 1e-4, 0.01);
        const auto told = [&](std::int64_t time_ns) {
            return behind.sample({1e-8 * static_cast<double>(time_ns), 10, time_ns});
        };
        for (std::int64_t n = 1; n < 8; ++n) {
            const EncoderSample regular = told(n * kPeriod_ns);
            LONGS_EQUAL(n * kPeriod_ns - kPeriod_ns / 2, regular.time_ns);
            if (n > 1) DOUBLES_EQUAL(1e-8 * static_cast<double>(regular.time_ns), regular.position_rad, 1e-9);
            LONGS_EQUAL(regular.time_ns, told(n * kPeriod_ns + asked_ns * kTenth_ns / 10).time_ns);
        }
        // One as near as others make it wait is a regular one.
        const std::int64_t late_ns = 8 * kPeriod_ns + kTenth_ns - 1;
        LONGS_EQUAL(late_ns - kPeriod_ns / 2, told(late_ns).time_ns);
        // A drive that has another beat, as after it was switched on, is followed after two periods and a
        // half.
        const std::int64_t anew_ns = late_ns + 4 * kTenth_ns;
        LONGS_EQUAL(late_ns - kPeriod_ns / 2, told(anew_ns + kPeriod_ns).time_ns);
        LONGS_EQUAL(anew_ns + 2 * kPeriod_ns + kTenth_ns - kPeriod_ns / 2,
                    told(anew_ns + 2 * kPeriod_ns + kTenth_ns).time_ns);
    }
}

// However short the period is, a frame may wait for others by half a millisecond.
TEST(EncoderLoop, off_the_beat_is_further_than_frames_wait_for_each_other) {
    constexpr std::int64_t kPeriod_ns = 2'000'000;
    for (const std::int64_t late_ns : {-501'000, -499'000, 499'000, 501'000}) {
        EncoderBehindLoop behind;
        behind.configure(0.01, 1e-4, 0.002);
        behind.sample({3, 10, 4 * kPeriod_ns});
        const EncoderSample next = behind.sample({3.02, 10, 5 * kPeriod_ns + late_ns});
        const bool taken = std::abs(late_ns) < 500'000;
        LONGS_EQUAL(taken ? 5 * kPeriod_ns + late_ns - kPeriod_ns / 2 : 4 * kPeriod_ns - kPeriod_ns / 2,
                    next.time_ns);
    }
}

// Position and speed are of one loop: as far as two of its periods, a third of the time and a tenth of the
// lag for what the speed has gained, and a digit go.
TEST(EncoderLoop, a_speed_that_is_not_the_positions_own_undoes_nothing) {
    constexpr double kLoop_s = 1e-4, kLag_s = 0.01, kAhead_s = 2 * kLag_s - kLoop_s / 2;
    struct Row {
        double from, gained;
        int reports;
    };
    for (const Row& row :
         {Row{0, 0, 1}, {40, 0, 1}, {-40, 0, 2}, {0, 6, 1}, {0, -6, 3}, {30, 5, 2}, {0, 40, 2}}) {
        const double passed_s = row.reports * kCycle_s;
        const double speed = row.from + row.gained / 2;
        const double most_rad =
            2 * kLoop_s * std::abs(speed) + (passed_s / 3 + kAhead_s / 20) * std::abs(row.gained) + 4e-4;
        for (const double off : {-1.001, -0.999, 0.999, 1.001}) {
            EncoderBehindLoop behind;
            behind.configure(kLag_s, kLoop_s, kCycle_s);
            behind.sample({3, row.from, 8'000'000});
            const double way_rad = kAhead_s * row.gained + speed * passed_s + off * most_rad;
            const EncoderSample angle =
                behind.sample({3 + way_rad, row.from + row.gained, 8'000'000 + row.reports * 1'000'000});
            if (std::abs(off) > 1) {
                DOUBLES_EQUAL(0, behind.unsure_rad(), 0);
                DOUBLES_EQUAL(3 + way_rad * (1 - 0.5 / row.reports), angle.position_rad, 1e-12);
            } else if (row.gained != 0) {
                CHECK(behind.unsure_rad() > 0);
                if (row.reports > 1) {  // no count is known; the time is what the reports say
                    const double off_rad = kLag_s * (kLag_s - 2 * kLoop_s) * row.gained / passed_s;
                    DOUBLES_EQUAL(std::abs(off_rad) / 30, behind.unsure_rad(), 1e-12);
                }
            } else if (row.reports > 1) {
                DOUBLES_EQUAL(3 + way_rad - kCycle_s / 2 * row.from, angle.position_rad, 1e-12);
            }
        }
    }
}

TEST(EncoderLoop, undone_it_is_the_mean_angle_between_two_reports) {
    for (const double bandwidth : {60.0, 100.0, 330.0, 1000.0, 1900.0}) {
        Reports reports(bandwidth);
        CHECK(reports.behind.undone());
        double left_rad = 0, off_rad = 0;
        for (int n = 0; n < 4000; ++n) {
            const EncoderSample reported = reports.next(n % 97 == 3 ? 9 : n % 97 == 4 ? 7 : 8);
            if (n % 101 == 50) continue;  // lost
            const EncoderSample angle = reports.behind.sample(reported);
            LONGS_EQUAL(reports.time_ns - 500'000, angle.time_ns);
            DOUBLES_EQUAL(reported.speed_rad_per_s, angle.speed_rad_per_s, 0);
            const EncoderSample again = reports.behind.sample(reported);
            DOUBLES_EQUAL(angle.position_rad, again.position_rad, 0);
            if (n < 100) continue;  // until the loop follows
            // a mean over eight periods is half a period's way from the middle
            const double way_rad = reports.wheel.angle_rad - reports.wheel.before_rad;
            const double middle_rad = reports.mean_rad - way_rad / 2;
            left_rad = std::max(left_rad, std::abs(angle.position_rad - middle_rad));
            off_rad =
                std::max(off_rad, std::abs(reported.position_rad - kPeriods * way_rad / 2 - middle_rad));
        }
        std::printf("  %4.0f rad/s: off by %.3f mrad, undone by %.3f\n", bandwidth, 1e3 * off_rad,
                    1e3 * left_rad);
        CHECK(left_rad < 1e-4 + off_rad / 20);
    }
}

TEST(EncoderLoop, a_wheel_that_stops_at_once_stands_although_the_loop_goes_on) {
    for (const double bandwidth : {60.0, 100.0, 330.0}) {
        for (const double wrong : {0.993, 1.0, 1.007}) {
            Reports reports(bandwidth);
            reports.behind.configure(wrong / bandwidth, kPeriod_s, kCycle_s);
            const auto speed = [&] {
                return (reports.wheel.angle_rad - reports.wheel.before_rad) / kPeriod_s;
            };
            for (int n = 0; n < 500 || std::abs(speed()) < 3; ++n) reports.behind.sample(reports.next(8));
            reports.stands = true;
            reports.behind.sample(reports.next(8));
            int crept = 0;
            for (int n = 0; n < 500; ++n) {
                const EncoderSample reported = reports.next(n % 7 == 3 ? 9 : n % 7 == 4 ? 7 : 8);
                const double angle_rad = reports.behind.sample(reported).position_rad;
                crept += std::abs(reported.position_rad - reports.wheel.angle_rad) > 1e-3;
                const double off_rad = std::abs(angle_rad - reports.wheel.angle_rad);
                if (n >= 8)  // before, what it was off by in motion is still seen
                    CHECK_TEXT(off_rad <= reports.behind.unsure_rad() + 3e-5, std::to_string(n).c_str());
            }
            CHECK(crept > 5);
        }
    }
}

TEST(EncoderLoop, one_that_follows_within_four_of_its_periods_or_is_not_known_changes_nothing) {
    EncoderBehindLoop behind;
    const auto same = [&behind](const EncoderSample& reported) {
        const EncoderSample angle = behind.sample(reported);
        DOUBLES_EQUAL(reported.position_rad, angle.position_rad, 0);
        LONGS_EQUAL(reported.time_ns, angle.time_ns);
        DOUBLES_EQUAL(0, behind.unsure_rad(), 0);
    };
    for (const double lag_s : {-1.0, 0.0, 0.0005}) {
        if (lag_s >= 0) behind.configure(lag_s, kPeriod_s, kCycle_s);
        CHECK_FALSE(behind.undone());
        same({1, 2, 3'000'000});
        same({1.5, 7, 4'000'000});
    }
    behind.configure(0.00051, kPeriod_s, kCycle_s);
    CHECK(behind.undone());
    same({0, 0, 0});  // nothing was reported yet
}

// A single report may agree by chance, and one that does not is followed by others.
TEST(EncoderLoop, after_a_speed_that_is_not_the_positions_own_three_have_to_be) {
    EncoderBehindLoop behind;
    behind.configure(0.01, 1e-4, kCycle_s);
    constexpr double kAhead_s = 0.02 - 0.5e-4;
    double position_rad = 1, speed = 0;
    std::int64_t time_ns = 9'000'000;
    const auto undone = [&](double off_rad) {
        position_rad += kAhead_s + (speed + 0.5) * kCycle_s + off_rad;
        speed += 1;
        time_ns += 1'000'000;
        behind.sample({position_rad, speed, time_ns});
        return behind.unsure_rad() > 0;
    };
    behind.sample({position_rad, speed, time_ns});
    CHECK(undone(0));
    CHECK_FALSE(undone(0.1));
    for (const bool again : {false, false, true, true}) CHECK_EQUAL(again, undone(0));
}

namespace {

// What of a wheel's motion a drive tells as its position and as its speed, each cycle.
struct Scales {
    double lag_s = 0.001, position = 1, speed = 1;
    Reports reports{1000};
    EncoderScale scale;
    int cycles = 0;
    double from_rad = 0;

    explicit Scales(double known_lag_s = 0.001) { scale.configure(known_lag_s, 0.001); }
    bool differs(int more_cycles) {
        for (int n = 0; n < more_cycles; ++n) {
            EncoderSample reported = reports.next();
            if (cycles++ == 0) from_rad = reported.position_rad;
            reported.position_rad = from_rad + position * (reported.position_rad - from_rad);
            reported.speed_rad_per_s *= speed;
            for (int seen = 0; seen < 2; ++seen) scale.take(reported);
        }
        return scale.differs();
    }
    int differing(int more_cycles) {
        int count = 0;
        for (int n = 0; n < more_cycles; ++n) count += differs(1);
        return count;
    }
};

}  // namespace

TEST(EncoderLoop, positions_and_speeds_of_one_scale_do_not_differ) {
    for (const double known_lag_s : {0.0, 0.0009, 0.001, 0.0011}) {
        Scales scales(known_lag_s);
        LONGS_EQUAL(0, scales.differing(20'000));
        scales.reports.stands = true;
        LONGS_EQUAL(0, scales.differing(2000));
    }
    for (const double share : {0.8, 1.2}) {  // as far as units and clocks may be wrong
        Scales scales;
        scales.position = share;
        LONGS_EQUAL(0, scales.differing(20'000));
    }
}

TEST(EncoderLoop, positions_or_speeds_that_tell_another_multiple_of_the_way_do) {
    for (const double share : {-1.0, 0.4, 0.5, 0.7, 1.5, 2.0}) {
        for (const bool of_speed : {false, true}) {
            Scales scales;
            (of_speed ? scales.speed : scales.position) = share;
            const int told = scales.differing(20'000);
            std::printf("  %.1f of the %s: %.2f of the time\n", share, of_speed ? "speed" : "position",
                        told / 2e4);
            CHECK(told > 11'000);
            scales.position = scales.speed = 1;
            scales.differs(200);
            LONGS_EQUAL(0, scales.differing(2000));
            scales.reports.stands = true;
            scales.position = 0.5;
            scales.differs(500);
            CHECK_FALSE(scales.scale.differs());  // of long ago
        }
    }
    // on the way at a steady speed: known after some spans, and the lag need not be
    for (const double known_lag_s : {0.0, 0.001}) {
        EncoderScale scale;
        scale.configure(known_lag_s, 0.001);
        int cycle = 0;
        double position_rad = 3;
        const auto next = [&](double share) {
            position_rad += share * 5 * kCycle_s;
            scale.take({position_rad, 5, std::int64_t{1'000'000} * ++cycle});
            return scale.differs();
        };
        for (int n = 0; n < 1000; ++n) CHECK_FALSE(next(1));
        int unseen = 0;
        while (!next(0.5)) ++unseen;
        std::printf("  half of the way is told after %d ms\n", unseen);
        CHECK(unseen < 130);
    }
}

// Neither speeds that have nothing to do with the positions, nor a wild one, nor what a wheel that hardly
// turns tells: a position that stands is the encoder watch's.
TEST(EncoderLoop, speeds_that_are_no_multiple_of_the_positions_do_not_differ_from_them) {
    std::mt19937 random{11};
    std::uniform_real_distribution any(-100.0, 100.0);
    EncoderScale scale;
    scale.configure(0.001, 0.001);
    double position_rad = 0;
    for (int cycle = 1; cycle < 100'000; ++cycle) {
        const double speed = cycle < 50'000 ? 4 : 0;
        position_rad += speed * kCycle_s;
        scale.take({position_rad, any(random), std::int64_t{1'000'000} * cycle});
        CHECK_FALSE(scale.differs());
    }
    EncoderScale wild;
    wild.configure(0.001, 0.001);
    EncoderScale slow = wild;
    for (int cycle = 1; cycle < 1000; ++cycle) {
        const auto time_ns = std::int64_t{1'000'000} * cycle;
        wild.take({4e-3 * cycle, cycle == 500 ? 1e30 : 4.0, time_ns});
        slow.take({0.3e-3 * cycle, 0.6, time_ns});
        CHECK_FALSE(wild.differs() || slow.differs());
    }
}

// A quick loop behind a coarse encoder tells a speed that leaps with each count. Where reports come in step
// with some counts they are too fast for a while, by less than they leap, and then too slow.
TEST(EncoderLoop, speeds_that_leap_with_the_counts_are_of_one_scale) {
    constexpr double kSpeed = 2.5, kOff = 0.4 * kSpeed, kLeap = 4, kBeat_s = 0.4;
    EncoderScale scale;
    scale.configure(0.0002, 0.001);
    for (int cycle = 1; cycle < 10'000; ++cycle) {
        const double t_s = kCycle_s * cycle;
        const double speed = kSpeed + kOff * std::sin(2 * 3.14159265358979323846 / kBeat_s * t_s) +
                             (cycle % 5 != 0   ? 0
                              : cycle % 2 == 0 ? kLeap / 2
                                               : -kLeap / 2);
        scale.take({kSpeed * t_s, speed, std::int64_t{1'000'000} * cycle});
        CHECK_FALSE(scale.differs());
    }
}

// A torque that learns on purpose makes such speeds; seen at their crests alone they would be another scale.
TEST(EncoderLoop, a_speed_that_swings_as_often_as_it_is_compared_is_of_one_scale) {
    constexpr double kMean = 2, kSwing = 1.5;  // rad/s
    for (const double period_s : {0.0025, 0.005, 0.006, 0.010}) {
        const double rate = 2 * 3.14159265358979323846 / period_s;
        EncoderScale scale;
        scale.configure(0, 0.001);
        for (int cycle = 1; cycle < 5000; ++cycle) {
            const double t_s = kCycle_s * cycle;
            scale.take({kMean * t_s + kSwing / rate * std::sin(rate * t_s),
                        kMean + kSwing * std::cos(rate * t_s), std::int64_t{1'000'000} * cycle});
            CHECK_FALSE(scale.differs());
        }
    }
}

namespace {

// The same of all that was reported, by the formula: spans of 5 to 10 ms, weighed by 0.85 less each.
struct ScaleByFormula {
    double lag_s;
    std::vector<EncoderSample> span;  // reports since the last that ended one, that one first
    std::vector<double> by_speed_rad, by_position_rad;
    double leaps_rad_per_s = 0;
    bool differs = false;

    bool take(const EncoderSample& reported, bool may_end) {
        if (!span.empty() && reported.time_ns == span.back().time_ns) return false;
        span.push_back(reported);
        const std::int64_t passed_ns = reported.time_ns - (span.size() > 1 ? span[0].time_ns : 0);
        if (!may_end || (span.size() > 1 && passed_ns < 5'000'000)) return false;
        if (span.size() > 1 && passed_ns <= 10'000'000) {
            double sum = 0;
            for (std::size_t i = 1; i < span.size(); ++i)
                sum += (span[i].speed_rad_per_s + span[i - 1].speed_rad_per_s) / 2;
            const double gained = reported.speed_rad_per_s - span[0].speed_rad_per_s;
            const double e = 1e-9 * double(passed_ns) * sum / double(span.size() - 1) + 2 * lag_s * gained;
            const double off = reported.position_rad - span[0].position_rad - e;
            leaps_rad_per_s = 0.85 * leaps_rad_per_s + 0.15 * std::abs(gained);
            const double unsure = (lag_s > 0 ? 0.2 * lag_s : 0.04) * std::abs(gained) +
                                  1e-9 * double(passed_ns) * leaps_rad_per_s / 2;
            by_speed_rad.push_back(e);
            by_position_rad.push_back(std::abs(off) <= unsure ? e : e + off - std::copysign(unsure, off));
            judge();
        }
        span = {reported};
        return true;
    }
    void judge() {
        double size = 0, ee = 0, pp = 0, ep = 0;
        for (std::size_t i = 0; i < by_speed_rad.size(); ++i) {
            const double weight = std::pow(0.85, double(by_speed_rad.size() - 1 - i));
            const double e = by_speed_rad[i], p = by_position_rad[i];
            size += weight * std::abs(e);
            ee += weight * e * e;
            pp += weight * p * p;
            ep += weight * e * p;
        }
        differs = std::sqrt(ee) >= 0.03 && size * size / ee >= 6 && std::abs(ep / ee) >= 0.25 &&
                  std::abs(ep / ee - 1) >= 0.25 && ep * ep / (ee * pp) >= 0.98;
    }
};

}  // namespace

TEST(EncoderLoop, scales_differ_as_their_formula_says) {
    int differing = 0, reports = 0;
    for (unsigned seed = 0; seed < 3000; ++seed) {
        std::mt19937 random(seed);
        const auto uniform = [&](double least, double most) {
            return std::uniform_real_distribution(least, most)(random);
        };
        const double lag_s = seed % 3 == 0 ? 0 : uniform(0, 0.01);
        const double share = uniform(-0.6, 2.2), mean = uniform(-6, 6),
                     noise = uniform(0, 1.5) * uniform(0, 1.5);
        const double swing = uniform(0, 8) * uniform(0, 1), lost = uniform(0, 1) * uniform(0, 1);
        EncoderScale scale;
        scale.configure(lag_s, 0.001);
        ScaleByFormula formula{lag_s, {}, {}, {}, 0, false};
        double position_rad = uniform(-9, 9), before = 0;
        for (int cycle = seed % 2 == 0 ? 7 : 3000; reports % 150 != 149; ++cycle, ++reports) {
            const double speed = mean + swing * std::sin(0.05 * cycle) + noise * uniform(-1, 1);
            position_rad += share * (kCycle_s * speed + 2 * lag_s * (speed - before));
            before = speed;
            if (cycle % 150 > 90 && uniform(0, 1) < lost) continue;
            const EncoderSample reported{position_rad, speed, std::int64_t{1'000'000} * cycle};
            for (int seen = random() % 3 == 0 ? 2 : 1; seen > 0; --seen) {
                const bool may_end = formula.span.empty() || random() % 8 != 0;
                CHECK_EQUAL(formula.take(reported, may_end),
                            may_end ? scale.take(reported) : scale.take(reported, false));
            }
            CHECK_EQUAL_TEXT(formula.differs, scale.differs(), std::to_string(seed).c_str());
            differing += scale.differs();
        }
        ++reports;
    }
    std::printf("  %d of %d reports differ\n", differing, reports);
    CHECK(differing > reports / 40 && differing < reports / 2);
}
