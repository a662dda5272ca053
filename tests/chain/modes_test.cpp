// Modes and faults through the whole chain: what each fault does to the torque on the bus, what it is called,
// and how it is cleared; and that switching between modes makes no bump.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

#include "firmware/protocol/command_guard.hpp"
#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;
using protocol::Fault;
using protocol::Mode;

TEST_GROUP(ChainModes){};

namespace {

// Drives forward at 0.5 m/s in velocity mode.
void cruise(Simulation& sim) {
    sim.run_for(0.5);
    sim.host().velocity({0.5, 0.2});
    CHECK(enter_mode(sim, Mode::velocity));
    sim.run_for(0.5);
    CHECK(std::abs(sim.world().twist().v_m_per_s - 0.5) < 0.02);
}

struct FaultCase {
    const char* name;
    Fault fault;
    double detected_within_s;  // from the cause
    std::function<void(Simulation&)> cause;
    std::function<void(Simulation&)> mend;
};

void nothing(Simulation&) {}

}  // namespace

TEST(ChainModes, each_fault_takes_the_torque_away_within_two_cycles_of_its_detection_and_names_itself) {
    const FaultCase cases[] = {
        {"stale command", Fault::stale_command, 0.07, [](Simulation& s) { s.host().silence(); }, nothing},
        {"stop message", Fault::emergency_stop_message, 0.004,
         [](Simulation& s) { s.host().emergency_stop(); }, nothing},
        {"stop line", Fault::emergency_stop_line, 0.003,
         [](Simulation& s) { s.emergency_stop().set(hal::LineLevel::active); },
         [](Simulation& s) { s.emergency_stop().set(hal::LineLevel::inactive); }},
        {"stop line unreadable", Fault::emergency_stop_line, 0.003,
         [](Simulation& s) { s.emergency_stop().set(hal::LineLevel::unknown); },
         [](Simulation& s) { s.emergency_stop().set(hal::LineLevel::inactive); }},
        {"drive error", Fault::drive_error, 0.12, [](Simulation& s) { s.world().left().raise_error(0x1); },
         nothing},
        {"drive drops out without an error", Fault::drive_left_armed_state, 0.12,
         [](Simulation& s) { s.world().right().drop_out(); }, nothing},
        {"feedback stale", Fault::stale_feedback, 0.015,
         [](Simulation& s) { s.world().left().faults().mute = true; },
         [](Simulation& s) { s.world().left().faults().mute = false; }},
        {"over speed", Fault::over_speed, 0.5,
         [](Simulation& s) {
             // as fast as anything pushes a robot
             for (double v_m_per_s = 0.6; v_m_per_s < 3.6; v_m_per_s += 0.1) {
                 s.world().plant().place(s.world().pose(), {v_m_per_s, 0});
                 s.run_for(1e-3);
             }
         },
         nothing},
        {"bus down", Fault::bus_down, 0.004, [](Simulation& s) { s.bus().set_down(0, true); },
         [](Simulation& s) { s.bus().set_down(0, false); }},
    };
    for (const FaultCase& one : cases) {
        SimulationOptions options = chain::options(2);
        options.emergency_stop_line = true;
        Simulation sim(chain::identified(), chain::real().parameters, options);
        cruise(sim);
        one.cause(sim);
        const double since_s = sim.time_s();
        const bool detected = sim.run_until([&] { return sim.cycle().supervisor().mode() == Mode::fault; },
                                            one.detected_within_s + 1);
        const double took_s = sim.time_s() - since_s;
        CHECK_TEXT(detected, one.name);
        CHECK_TEXT(sim.cycle().supervisor().fault() == one.fault, one.name);
        CHECK_TEXT(took_s <= one.detected_within_s, one.name);
        sim.run_for(0.002);
        const auto torque = sim.cycle().report().torque_Nm;
        CHECK_TEXT(torque.left == 0 && torque.right == 0, one.name);
        std::printf("  %-34s detected after %5.1f ms\n", one.name, 1e3 * took_s);

        // It stays, whatever is asked, and clears once its cause is gone and the robot stands.
        sim.host().mode(Mode::velocity);
        sim.run_for(0.1);
        CHECK_TEXT(sim.cycle().supervisor().mode() == Mode::fault, one.name);
        one.mend(sim);
        sim.host().silence();
        sim.world().plant().place(sim.world().pose(), {0, 0});
        sim.run_for(0.5);
        sim.host().clear_fault();
        sim.run_for(0.5);
        CHECK_TEXT(sim.cycle().supervisor().mode() == Mode::idle, one.name);
        sim.host().velocity({0.1, 0});
        CHECK_TEXT(enter_mode(sim, Mode::velocity), one.name);
    }
}

TEST(ChainModes, a_configured_ramp_brakes_the_robot_before_the_torque_ends) {
    model::RobotParameters p = chain::identified();
    p.safety.stale_command_reaction = model::StopReaction::ramp;
    Simulation sim(p, chain::real().parameters, chain::options(3));
    cruise(sim);
    sim.host().silence();
    CHECK(sim.run_until([&] { return sim.cycle().supervisor().mode() == Mode::fault; }, 0.2));
    sim.run_for(0.2);
    std::printf("  braked from 0.5 m/s to %.3f m/s within 0.2 s\n", sim.world().twist().v_m_per_s);
    CHECK(std::abs(sim.world().twist().v_m_per_s) < 0.06);
    const auto torque = sim.cycle().report().torque_Nm;
    CHECK(torque.left == 0 && torque.right == 0);
    CHECK(sim.cycle().supervisor().fault() == Fault::stale_command);
}

// The torque that moved the robot against friction when it was stopped is none to begin with at rest.
TEST(ChainModes, loops_that_were_stopped_begin_anew) {
    model::RobotParameters truth = chain::real().parameters;
    truth.effects.parameter[model::find_effect("coulomb_friction")] = {1, 1};
    Simulation sim(chain::identified(), truth, chain::options(41));
    cruise(sim);
    CHECK(sim.cycle().report().torque_Nm.left > 0.8);
    sim.host().emergency_stop();
    CHECK(sim.run_until([&] { return sim.cycle().supervisor().mode() == Mode::fault; }, 0.1));
    sim.run_for(1);
    sim.host().clear_fault();
    sim.run_for(0.1);
    sim.host().velocity({0, 0});
    CHECK(enter_mode(sim, Mode::velocity));
    const WheelPair<double> torque = sim.cycle().report().torque_Nm;
    std::printf("  begins with %.3f, %.3f Nm\n", torque.left, torque.right);
    CHECK(std::max(std::abs(torque.left), std::abs(torque.right)) < 0.1);
}

TEST(ChainModes, termination_brakes_puts_the_drives_to_idle_and_ends) {
    Simulation sim(chain::identified(), chain::real().parameters, chain::options(4));
    cruise(sim);
    sim.cycle().request_termination();
    CHECK(sim.run_until([&] { return sim.cycle().finished(); }, 1.5));
    CHECK(std::abs(sim.world().twist().v_m_per_s) < 0.06);
    CHECK(sim.cycle().report().status.drive_left != protocol::DriveState::armed);
    CHECK(sim.cycle().report().status.drive_right != protocol::DriveState::armed);
}

TEST(ChainModes, arming_is_refused_when_the_drives_watchdog_is_not_known_to_be_on) {
    model::RobotParameters p = chain::identified();
    p.drive.watchdog_assured = false;
    p.drive.watchdog_endpoint = 0;
    Simulation sim(p, chain::real().parameters, chain::options(5));
    sim.run_for(0.5);
    sim.host().velocity({0.1, 0});
    CHECK_FALSE(enter_mode(sim, Mode::velocity));
    CHECK(sim.cycle().supervisor().fault() == Fault::arming_refused);
    CHECK(sim.cycle().supervisor().blocker() == protocol::Blocker::watchdog_not_confirmed);
}

// The story: the drives' errors were cleared by every arming, so that a robot whose drive had been stopped by
// hand drove off as if nothing had been.
TEST(ChainModes, a_drives_error_from_before_is_named_and_holds_the_robot_until_it_is_cleared) {
    struct Case {
        int generation;
        std::uint32_t error;  // of each, an emergency stop and a fault
    };
    for (const Case& one : {Case{5, 0x4000}, Case{5, 0x100}, Case{6, 0x0200'0000}, Case{6, 0x200}}) {
        for (const bool is_left : {true, false}) {
            for (const bool reported :
                 {true, false}) {  // and when it is too new for any heartbeat to show it
                model::RobotParameters p = chain::identified();
                model::RobotParameters truth = chain::real().parameters;
                p.drive.generation = truth.drive.generation = one.generation;
                p.drive.watchdog_assured = true;
                Simulation sim(p, truth, chain::options(21));
                sim::SimOdrive& broken = is_left ? sim.world().left() : sim.world().right();
                sim.run_for(0.5);
                broken.raise_error(one.error);
                if (reported) sim.run_for(0.2);
                sim.host().velocity({0.3, 0});
                CHECK_FALSE(enter_mode(sim, Mode::velocity));
                CHECK(sim.cycle().supervisor().blocker() == protocol::Blocker::drive_error);
                CHECK(sim.cycle().supervisor().mode() == (reported ? Mode::idle : Mode::fault));
                sim.run_for(0.2);
                CHECK_EQUAL(one.error, broken.error_bits() & one.error);
                CHECK_EQUAL(one.error, sim.cycle().report().drive_error_bits[is_left ? 0 : 1] & one.error);
                CHECK_EQUAL(0U, sim.cycle().report().drive_error_bits[is_left ? 1 : 0] & one.error);
                CHECK_FALSE(sim.world().left().armed() || sim.world().right().armed());
                CHECK(std::abs(sim.world().twist().v_m_per_s) < 1e-3);

                sim.host().clear_fault();
                sim.run_for(0.005);
                CHECK(enter_mode(sim, Mode::velocity));  // the same breath
                sim.run_for(0.5);
                CHECK(std::abs(sim.world().twist().v_m_per_s - 0.3) < 0.02);
            }
        }
    }
}

TEST(ChainModes, clearing_a_fault_that_is_none_does_not_stop_a_robot_that_drives) {
    Simulation sim(chain::identified(), chain::real().parameters, chain::options(22));
    cruise(sim);
    sim.host().clear_fault();
    sim.run_for(0.3);
    CHECK(sim.cycle().supervisor().mode() == Mode::velocity);
    CHECK(std::abs(sim.world().twist().v_m_per_s - 0.5) < 0.02);
}

TEST(ChainModes, the_drives_watchdog_stops_the_wheels_when_the_firmware_dies) {
    Simulation sim(chain::identified(), chain::real().parameters, chain::options(6));
    cruise(sim);
    const double speed = sim.world().twist().v_m_per_s;
    sim.bus().set_down(0, true);  // not another frame from the firmware, as after kill -9
    sim.run_for(2);
    std::printf("  from %.2f m/s to %.3f m/s in 2 s on the drives' watchdog and friction\n", speed,
                sim.world().twist().v_m_per_s);
    CHECK(std::abs(sim.world().twist().v_m_per_s) < 0.1 * speed);
}

// Each driving mode into each other one, at speed, with a set-point that goes on as the robot moves: then
// only noise may change the torque of the first cycle.
TEST(ChainModes, switching_between_all_driving_modes_makes_no_bump) {
    constexpr Mode modes[] = {Mode::velocity, Mode::pose, Mode::trajectory, Mode::adaptive};
    double largest = 0;
    for (const Mode from : modes) {
        for (const Mode to : modes) {
            if (from == to) continue;
            Simulation sim(chain::identified(), chain::real().parameters, chain::options(8));
            sim.run_for(0.5);
            protocol::TrajectoryCommand command;
            command.shape = protocol::TrajectoryShape::streamed;
            sim.host().trajectory(command);
            cruise(sim);
            const Pose<double> here = sim.cycle().odometry().pose();
            const auto onward = [here](double time_s) {
                const Twist<double> twist{0.5, 0.2};
                return std::pair{
                    model::advance_along_arc(here, twist.v_m_per_s * time_s, twist.omega_rad_per_s * time_s),
                    twist};
            };
            if (from == Mode::trajectory || from == Mode::adaptive) {
                sim.host().stream(onward);
                sim.run_for(0.002);
                CHECK(enter_mode(sim, from));
                sim.run_for(0.1);
            } else if (from == Mode::pose) {
                CHECK(enter_mode(sim, from));
            }
            if (to == Mode::trajectory || to == Mode::adaptive) {
                if (from == Mode::velocity || from == Mode::pose) sim.host().stream(onward);
                sim.run_for(0.002);
            } else if (to == Mode::velocity) {
                sim.host().velocity({0.5, 0.2});
                sim.run_for(0.002);  // an older set-point would not count
            }
            const auto before = sim.cycle().report().torque_Nm;
            sim.host().mode(to);
            CHECK(sim.run_until([&] { return sim.cycle().supervisor().mode() == to; }, 0.02));
            const auto after = sim.cycle().report().torque_Nm;
            largest =
                std::max({largest, std::abs(after.left - before.left), std::abs(after.right - before.right)});
        }
    }
    std::printf("  largest change of torque at a switch: %.2f Nm\n", largest);
    CHECK(largest <= 1.5);
}

TEST(ChainModes, what_is_wrong_on_the_bus_is_counted_by_its_cause_and_changes_nothing) {
    Simulation sim(chain::identified(), chain::real().parameters, chain::options(9));
    sim.run_for(0.5);
    using Cause = protocol::CounterCause;
    const auto count = [&](Cause cause) { return sim.cycle().report().counters[std::size_t(cause)]; };
    hal::CanBus& bus = sim.host_bus();
    const auto raw = [&](std::uint32_t id, std::initializer_list<std::uint8_t> bytes, bool seal) {
        hal::CanFrame frame;
        frame.id = id;
        for (const std::uint8_t byte : bytes) frame.data[frame.length++] = byte;
        if (seal) protocol::seal({frame.data.data(), frame.length}, frame.data[1] & 0x0FU);
        bus.send(frame);
        sim.run_for(0.003);
    };
    struct Case {
        Cause cause;
        std::uint32_t id;
        std::initializer_list<std::uint8_t> bytes;
        bool seal;
    };
    const Case cases[] = {
        {Cause::rejected_length, 0x601, {0, 1}, true},
        {Cause::rejected_crc, 0x601, {0x55, 1, 4}, false},
        {Cause::rejected_alive, 0x601, {0, 15, 4}, true},
        {Cause::rejected_unknown_mode, 0x601, {0, 2, 9}, true},
        {Cause::rejected_unknown_mode, 0x601, {0, 3, 8}, true},
        {Cause::rejected_not_finite, 0x60A, {0, 1 | 0x10, 0x10, 0x00, 0, 0, 0xC0, 0x7F}, true},
        {Cause::rejected_range, 0x602, {0, 1, 0x00, 0x80, 0, 0}, true},
        {Cause::rejected_unpaired, 0x606, {0, 1, 0, 0, 0, 0}, true},
        {Cause::unknown_parameter, 0x60A, {0, 2, 0xFF, 0x3F, 0, 0, 0, 0}, true},
    };
    for (const Case& one : cases) {
        const auto before = count(one.cause);
        raw(one.id, one.bytes, one.seal);
        CHECK_EQUAL(before + 1, count(one.cause));
        CHECK(sim.cycle().supervisor().mode() == Mode::idle);
        CHECK_FALSE(sim.cycle().supervisor().wants_armed());
    }
    // A stale counter: the same frame twice.
    const auto before = count(Cause::rejected_alive);
    raw(0x60B, {0, 7}, true);
    raw(0x60B, {0, 7}, true);
    CHECK_EQUAL(before + 1, count(Cause::rejected_alive));
    // A mode that is not allowed now: adaptive without a trusted model.
    sim.parameters().dynamics_standard_error = {};
    sim.run_for(0.002);
    const auto refused = count(Cause::rejected_mode_not_allowed);
    sim.host().mode(Mode::adaptive);
    sim.run_for(0.01);
    CHECK_EQUAL(refused + 1, count(Cause::rejected_mode_not_allowed));
    CHECK(sim.cycle().supervisor().mode() == Mode::idle);
}
