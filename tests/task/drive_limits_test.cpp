// Supply and heat as the drives report them, against the limits: what counts, what is told, what is over
// when.
#include <cstdint>
#include <limits>

#include "firmware/task/drive_limits.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using task::DriveLimits;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

struct Reports {
    model::RobotParameters parameters = model::default_parameters();
    DriveLimits limits;
    drivers::DriveFeedback left, right;
    std::int64_t now_ns = 1'000'000'000;

    Reports() {
        parameters.safety.lowest_supply_V = 20;
        parameters.safety.highest_supply_V = 30;
        parameters.safety.motor_temperature_degC = 80;
        limits.configure(parameters, {8, 60, 110});
    }
    DriveLimits::Verdict nothing(std::int64_t after_ns = 1'000'000) {
        now_ns += after_ns;
        return limits.look(now_ns, left, right);
    }
    DriveLimits::Verdict supply(drivers::DriveFeedback& drive, double volts, int times = 1) {
        for (int i = 0; i < times; ++i) {
            drive.bus_voltage_V = volts;
            drive.supply_time_ns = now_ns;
            nothing(100'000'000);
        }
        return limits.verdict();
    }
    DriveLimits::Verdict heat(drivers::DriveFeedback& drive, double inverter_degC, double motor_degC,
                              int times = 3) {
        for (int i = 0; i < times; ++i) {
            drive.inverter_temperature_degC = inverter_degC;
            drive.motor_temperature_degC = motor_degC;
            drive.temperature_time_ns = now_ns;
            nothing(100'000'000);
        }
        return limits.verdict();
    }
};

}  // namespace

TEST_GROUP(DriveLimits) { Reports reports; };

TEST(DriveLimits, what_is_not_reported_is_never_out_of_limits) {
    for (int i = 0; i < 3000; ++i) {
        const DriveLimits::Verdict verdict = reports.nothing();
        CHECK(!verdict.supply_low && !verdict.supply_high && !verdict.overheated && !verdict.near);
    }
    CHECK(!reports.limits.told());
    CHECK(!reports.limits.health(0).supply_reported);
    reports.parameters.drive.supply_period_ms = 100;  // it should be reported: that is told
    reports.limits.configure(reports.parameters, {8, 60, 110});
    CHECK(reports.limits.told());
}

TEST(DriveLimits, three_reports_in_a_row_of_either_drive_count_and_one_alone_does_not) {
    for (drivers::DriveFeedback* drive : {&reports.left, &reports.right}) {
        for (int i = 0; i < 10; ++i) {
            CHECK(!reports.supply(*drive, 5, 2).supply_low);
            CHECK(!reports.supply(*drive, 24).supply_low);
        }
        CHECK(reports.supply(*drive, 19.9, 3).supply_low);
        CHECK(!reports.limits.verdict().supply_high && !reports.limits.verdict().overheated);
        CHECK(!reports.supply(*drive, 24, 3).supply_low);
        CHECK(reports.supply(*drive, 30.1, 3).supply_high);
        CHECK(!reports.limits.verdict().supply_low);
        CHECK(!reports.supply(*drive, 24, 3).supply_high);
    }
}

TEST(DriveLimits, near_the_limit_is_told_and_beyond_is_over_half_of_that_way_back) {
    CHECK(!reports.supply(reports.left, 21.1, 3).near);
    CHECK(reports.supply(reports.left, 20.9, 3).near);  // 5 % above the lowest
    CHECK(!reports.limits.verdict().supply_low);
    CHECK(reports.supply(reports.left, 21.4, 9).near);
    CHECK(!reports.supply(reports.left, 21.6, 3).near);
    CHECK(reports.supply(reports.left, 19.9, 3).supply_low);
    CHECK(reports.supply(reports.left, 20.4, 9).supply_low);
    CHECK(!reports.supply(reports.left, 20.6, 3).supply_low);
    CHECK(reports.limits.verdict().near);
    CHECK(!reports.supply(reports.left, 24, 3).near);
}

TEST(DriveLimits, inverter_and_motor_have_a_limit_each_and_what_is_not_measured_has_none) {
    CHECK(reports.heat(reports.right, 50, 81).overheated);
    CHECK(!reports.heat(reports.right, 50, 50).overheated);
    CHECK(!reports.heat(reports.right, 109, kNaN).overheated);  // auto: 110 degC
    CHECK(reports.limits.verdict().near);
    CHECK(reports.heat(reports.right, 111, kNaN).overheated);
    const protocol::DriveHealth health = reports.limits.health(1);
    CHECK(health.wheel == protocol::Wheel::right && health.inverter_reported && !health.motor_reported);
    DOUBLES_EQUAL(111, health.inverter_temperature_degC, 0);
    DOUBLES_EQUAL(0, health.motor_temperature_degC, 0);
}

TEST(DriveLimits, what_has_not_been_said_again_for_a_second_is_forgotten) {
    CHECK(reports.supply(reports.left, 5, 3).supply_low);
    CHECK(reports.heat(reports.left, 120, 20, 3).overheated);
    CHECK(reports.nothing(600'000'000).overheated);
    CHECK(!reports.nothing(500'000'000).overheated);
    CHECK(!reports.limits.verdict().supply_low && !reports.limits.verdict().near);
    CHECK(!reports.limits.told());
    reports.parameters.drive.supply_period_ms = 1000;  // three of its periods
    reports.limits.configure(reports.parameters, {8, 60, 110});
    CHECK(reports.supply(reports.left, 5, 3).supply_low);
    CHECK(reports.nothing(2'800'000'000).supply_low);
    CHECK(!reports.nothing(300'000'000).supply_low);
}
