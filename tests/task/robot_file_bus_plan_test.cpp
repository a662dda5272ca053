// The worst-case load of the buses, known before the first frame.
#include <algorithm>
#include <cstdio>
#include <string>

#include "drivers/drive_catalogue.hpp"
#include "firmware/task/bus_plan.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

TEST_GROUP(BusPlan){};

// Two ODrives at 1 kHz, torque commands and encoder estimates: 540 bits in each millisecond.
TEST(BusPlan, DrivesTakeTheShareOfTheBudgetTable) {
    model::RobotParameters p = model::default_parameters();
    p.drive.torque_period_ms = 0;
    p.drive.heartbeat_period_ms = 1000;
    const task::BusPlan plan = task::bus_plan(p);
    DOUBLES_EQUAL(0.540, plan.drive_load, 0.0005);
    std::printf("drives %.1f %%, host %.1f %%, shared %.1f %%\n", plan.drive_load * 100, plan.host_load * 100,
                plan.shared_load * 100);
    STRCMP_EQUAL("", task::bus_refusal(plan, p, true).c_str());
}

TEST(BusPlan, TorqueReportsEachMillisecondOnASharedBusAreRefusedByName) {
    model::RobotParameters p = model::default_parameters();
    p.drive.torque_period_ms = 1;
    const std::string refusal = task::bus_refusal(task::bus_plan(p), p, true);
    CHECK(refusal.find("bus shared by drives and host") != std::string::npos);
    CHECK(refusal.find("left Get_Torques 13.5 %") != std::string::npos);
    CHECK(refusal.find("80.0 %") != std::string::npos);
}

TEST(BusPlan, HalfTheBitRateIsTooLittleForTwoDrives) {
    model::RobotParameters p = model::default_parameters();
    p.bus.bit_rate_bit_per_s = 5e5;
    const task::BusPlan plan = task::bus_plan(p);
    CHECK(plan.drive_load > 1.08);
    CHECK(task::bus_refusal(plan, p, false).find("drives' bus") != std::string::npos);
    p.drive.generation = 5;
    CHECK(task::bus_refusal(task::bus_plan(p), p, false).find("Set_Input_Torque") != std::string::npos);
}

// What the drivers list, and nothing else: the plan knows no dialect.
TEST(BusPlan, DrivesFramesAreThoseOfTheirDriver) {
    for (const int generation : {5, 6}) {
        model::RobotParameters p = model::default_parameters();
        p.drive.generation = generation;
        const task::BusPlan plan = task::bus_plan(p);
        drivers::DriveSlot slot;
        const drivers::MotorDrive* drive = drivers::make_drive(slot, p, drivers::Wheel::right);
        CHECK(drive != nullptr);
        std::size_t planned = 0;
        for (const task::PlannedFrame& frame : plan.frames) planned += frame.drives ? 1U : 0U;
        LONGS_EQUAL(2 * drive->frames().size(), planned);
        for (const drivers::DriveFrame& frame : drive->frames()) {
            const std::string name = "right " + std::string(frame.name);
            const auto same = [&](const task::PlannedFrame& one) { return one.name == name; };
            const auto found = std::find_if(plan.frames.begin(), plan.frames.end(), same);
            CHECK(found != plan.frames.end());
            DOUBLES_EQUAL(frame.period_s, found->period_s, 1e-12);
        }
    }
}

TEST(BusPlan, SlowHostBusIsJudgedByItself) {
    model::RobotParameters p = model::default_parameters();
    p.bus.host_bit_rate_bit_per_s = 1e5;
    p.bus.load_limit = 0.6;
    const std::string refusal = task::bus_refusal(task::bus_plan(p), p, false);
    CHECK(refusal.find("host's bus") != std::string::npos);
    CHECK(refusal.find("Set_Input_Torque") == std::string::npos);
}
