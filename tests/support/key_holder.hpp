// Both ends of authenticated arming: what a firmware is given, and a host that may or may not hold its key.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/task/arming_guard.hpp"
#include "hal/can_bus.hpp"
#include "hal/linux/cryptography.hpp"
#include "sim_hal/random.hpp"

namespace wheelwright::support {

// Random enough for a test, and the same each time.
class SeededRandom final : public hal::RandomSource {
  public:
    explicit SeededRandom(std::uint64_t seed) : random_(seed) {}
    bool fill(std::span<std::uint8_t> out) override {
        if (empty) return false;
        for (std::uint8_t& byte : out) byte = static_cast<std::uint8_t>(256 * random_.uniform());
        return true;
    }
    bool empty = false;

  private:
    sim::Random random_;
};

class KeyHolder {
  public:
    explicit KeyHolder(std::uint8_t key = 7, std::string robot = "robot", std::uint64_t seed = 1)
        : random(seed), robot_(std::move(robot)) {
        std::array<std::uint8_t, 16> bytes{};
        bytes.fill(key);
        code_ = std::move(hal::make_aes_cmac(bytes).value());
    }

    task::ArmingKey key() { return {code_.get(), &random, robot_}; }

    protocol::ArmingAnswer answer(const protocol::ArmingChallenge& challenge, protocol::Mode mode) {
        return task::answer_to(challenge, mode, key()).value();
    }

    // A host's end of a bus, from now on open to challenges. The last one that has come.
    static void listen(hal::CanBus& bus) {
        const hal::CanFilter filter{protocol::ArmingChallenge::id, 0x7FF, false};
        bus.set_filters({&filter, 1});
    }
    static std::optional<protocol::ArmingChallenge> heard(hal::CanBus& bus) {
        std::optional<protocol::ArmingChallenge> last;
        hal::ReceivedFrame received;
        while (bus.receive(received) == hal::CanStatus::ok) {
            protocol::ArmingChallenge challenge;
            if (protocol::ArmingChallenge::decode({received.frame.data.data(), received.frame.length},
                                                  challenge) == protocol::CodecStatus::ok)
                last = challenge;
        }
        return last;
    }

    hal::CanFrame frame(const protocol::ArmingAnswer& answer) {
        hal::CanFrame frame;
        frame.id = protocol::ArmingAnswer::id;
        frame.length = protocol::ArmingAnswer::length;
        alive_ = protocol::next_alive(alive_);
        static_cast<void>(protocol::encode_sealed(answer, alive_, frame.data));
        return frame;
    }

    SeededRandom random;

  private:
    std::string robot_;
    std::unique_ptr<hal::MessageCode> code_;
    std::uint8_t alive_ = 0;
};

}  // namespace wheelwright::support
