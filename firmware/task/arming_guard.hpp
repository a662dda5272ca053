// Authenticated arming: who asks for a mode that arms the drives must show that he holds the key. The
// question is a fresh random challenge, the answer a code over it, over the mode and over the robot's name
// (firmware/protocol/arming_code.hpp).
//
//     one challenge at a time, valid for kValid_ns; who else asks in its first half is told the same one, who
//     asks later waits for the next, so that nobody can spoil another one's challenge by asking
//     one answer for a challenge: right or wrong, it is used up
//     a wrong answer delays the next challenge, twice as long each time, never longer than kMostDelay_ns; a
//     right one ends that. An answer to no challenge changes nothing, for it could not have been right.
//
// Without a key nothing is asked. The key is none of the parameters: no frame can read or change it.
//
// Threads: the cycle's. No call allocates, blocks or throws.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "firmware/protocol/wheelwright_messages.hpp"
#include "hal/message_code.hpp"
#include "hal/random_source.hpp"

namespace wheelwright::task {

// All of it outlives whoever is given it. Both pointers, or neither: then there is no key. In a cycle neither
// allocates, blocks or calls the system.
struct ArmingKey {
    hal::MessageCode* code = nullptr;
    hal::RandomSource* random = nullptr;
    std::string_view robot;

    explicit operator bool() const { return code != nullptr; }
};

// What the holder of a key answers; nothing when the code cannot be computed.
std::optional<protocol::ArmingAnswer> answer_to(const protocol::ArmingChallenge& challenge,
                                                protocol::Mode mode, const ArmingKey& key);

class ArmingGuard {
  public:
    static constexpr std::int64_t kValid_ns = 1'000'000'000;
    static constexpr std::int64_t kRepeat_ns = 20'000'000;  // between two frames of one challenge
    static constexpr std::int64_t kFirstDelay_ns = 100'000'000;
    static constexpr std::int64_t kMostDelay_ns = 3'200'000'000;

    explicit ArmingGuard(const ArmingKey& key) : key_(key) {}

    bool has_key() const { return static_cast<bool>(key_); }

    // Somebody asked for what needs a proof. Asked again, or by two: one challenge follows.
    void ask() { asked_ = true; }

    // The challenge to send in this cycle, if any.
    std::optional<protocol::ArmingChallenge> challenge(std::int64_t now_ns) {
        return asked_ ? due(now_ns) : std::nullopt;
    }

    // Whether this answers the challenge that is valid now.
    bool accept(const protocol::ArmingAnswer& answer, std::int64_t now_ns);

  private:
    std::optional<protocol::ArmingChallenge> due(std::int64_t now_ns);

    ArmingKey key_;
    bool asked_ = false;
    protocol::ArmingChallenge challenge_;
    bool valid_ = false;  // the challenge awaits its answer, if it is not too old
    std::int64_t drawn_ns_ = 0;
    std::int64_t sent_ns_ = 0;
    std::int64_t next_ns_ = 0;   // no new challenge before
    std::int64_t delay_ns_ = 0;  // after the last wrong answer
};

}  // namespace wheelwright::task
