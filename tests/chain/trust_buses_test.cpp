// What may go wrong on the buses and with the computers at their ends, judged like trust_test.cpp on the robot's
// true motion and torque.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "tests/chain/scene.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace chain;

TEST_GROUP(ChainBuses){};

namespace {

// What passes on the drives' bus: the last frame of a stranger, the firmware's torques since, and when both drives
// have been told to stop.
class Witness final : public sim::BusTap {
  public:
    void on_frame(const sim::WireEvent& event) override {
        if (event.sender == 2) {
            stranger_ns = event.end_ns;
            torques = 0;
            stopped_ns = {};
        }
        if (event.sender != 0) return;
        const std::uint32_t command = event.frame->id & 0x1FU;
        const bool left = event.frame->id >> 5U == std::uint32_t(real().parameters.drive.left.node);
        float torque = 0;
        std::memcpy(&torque, event.frame->data.data(), 4);
        if (command == kSetInputTorque && torque != 0) {
            ++torques;
            stopped_ns[left ? 0 : 1] = 0;
        } else if ((command == kSetInputTorque || command == kSetAxisState) && stopped_ns[left ? 0 : 1] == 0) {
            stopped_ns[left ? 0 : 1] = event.end_ns;
        }
    }
    double stop_ms() const {
        return 1e-6 * static_cast<double>(std::max(stopped_ns[0], stopped_ns[1]) - stranger_ns);
    }
    std::int64_t stranger_ns = 0;
    std::array<std::int64_t, 2> stopped_ns{};
    int torques = 0;
};

}  // namespace

// The drives' bus is full of a stranger's frames, which go first; then it is free again. Of the firmware's frames
// seven wait at most, and one old torque for each drive among them; in front of them are those that the drives had
// waiting. When these have passed, there is no torque; or when the drives' watchdogs expire.
TEST(ChainBuses, a_jam_leaves_one_old_torque_for_each_drive_at_most) {
    constexpr double kFrame_ms = 0.138;
    double longest_ms = 0;
    int most = 0;
    for_each_layout([&](const Layout& layout) {
        for (const double jam_s : {0.003, 0.008, 0.015, 0.03, 0.04}) {
            for (const bool line : {false, true}) {
                Scene scene(layout);
                Witness witness;
                scene.sim.bus().add_tap(witness);
                scene.sim.bus().limit_transmit_queue(1, 6);  // three mailboxes for each drive
                scene.sim.host().velocity({3 * layout.way, 0});
                CHECK(enter_mode(scene.sim, Mode::velocity));
                scene.sim.run_for(0.05);  // at full torque
                CHECK(scene.true_torque_Nm() > 3);
                scene.sim.host().external_poses(false);
                scene.sim.host().silence();
                hal::CanFrame first;
                first.length = 8;
                if (line) scene.sim.emergency_stop().set(hal::LineLevel::active);
                scene.run(jam_s, [&] {
                    for (int i = 0; i < 16; ++i) scene.foreign(first);
                });
                scene.sim.emergency_stop().set(hal::LineLevel::active);
                scene.run(0.2);
                const std::string text = layout.name() + ", jam of " + std::to_string(jam_s) +
                                         " s: torque until " + std::to_string(witness.stop_ms()) +
                                         " ms after it, " + std::to_string(witness.torques) + " old torques";
                longest_ms = std::max(longest_ms, witness.stop_ms());
                most = std::max(most, witness.torques);
                CHECK_TEXT(witness.torques <= 2, text.c_str());
                // seven of the firmware's, six of the drives', and what these send meanwhile
                CHECK_TEXT(witness.stop_ms() <= (7 + 6 + 2 * 2) * kFrame_ms, text.c_str());
                CHECK(scene.fault() != Fault::none);
                CHECK_EQUAL(0, scene.true_torque_Nm());
            }
        }
    });
    std::printf("  told to stop %.2f ms after the jam at most, %d old torques\n", longest_ms, most);
}
