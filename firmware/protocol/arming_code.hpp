// What an ArmingAnswer's code is over, and how it is read: AES-128-CMAC (RFC 4493), cut to 48 bits. Computing
// the CMAC is not done here. Nothing here allocates or throws.
//
//     byte 0         1: arming
//     byte 1         the mode asked for
//     bytes 2 to 9   the challenge, as in its frame
//     then           the robot's name in the key file, at most kMostRobotName bytes
//
// So an answer is good for one robot, one mode and one challenge.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::protocol {

inline constexpr std::size_t kMostRobotName = 32;

class ArmingText {
  public:
    // Of a name that is too long, the rest does not count.
    constexpr ArmingText(Mode mode, const ArmingChallenge& challenge, std::string_view robot) {
        put(1);
        put(static_cast<std::uint8_t>(mode));
        for (const std::uint32_t half : {challenge.nonce_low, challenge.nonce_high}) {
            for (unsigned shift = 0; shift < 32; shift += 8) put(static_cast<std::uint8_t>(half >> shift));
        }
        for (const char byte : robot.substr(0, kMostRobotName)) put(static_cast<std::uint8_t>(byte));
    }

    constexpr std::span<const std::uint8_t> bytes() const { return {bytes_.data(), length_}; }

  private:
    constexpr void put(std::uint8_t byte) { bytes_[length_++] = byte; }

    std::array<std::uint8_t, 10 + kMostRobotName> bytes_{};
    std::size_t length_ = 0;
};

// The answer for a mode with the first six bytes of a CMAC; crc and alive are the sender's.
constexpr ArmingAnswer arming_answer(Mode mode, const std::array<std::uint8_t, 16>& cmac) {
    ArmingAnswer answer;
    answer.mode = mode;
    for (unsigned i = 0; i < 4; ++i) answer.code_low |= std::uint32_t{cmac[i]} << 8 * i;
    answer.code_high = static_cast<std::uint16_t>(cmac[4] | cmac[5] << 8);
    return answer;
}

// Takes the same time wherever the codes differ.
constexpr bool same_code(const ArmingAnswer& a, const ArmingAnswer& b) {
    const std::uint32_t low = a.code_low ^ b.code_low;
    const std::uint32_t high = std::uint32_t{a.code_high} ^ b.code_high;
    return (low | high) == 0;
}

}  // namespace wheelwright::protocol
