#include "firmware/task/arming_guard.hpp"

#include <algorithm>
#include <array>
#include <bit>

#include "firmware/protocol/arming_code.hpp"

namespace wheelwright::task {

std::optional<protocol::ArmingAnswer> answer_to(const protocol::ArmingChallenge& challenge,
                                                protocol::Mode mode, const ArmingKey& key) {
    std::array<std::uint8_t, 16> cmac{};
    if (!key.code->compute(protocol::ArmingText(mode, challenge, key.robot).bytes(), cmac)) {
        return std::nullopt;
    }
    return protocol::arming_answer(mode, cmac);
}

std::optional<protocol::ArmingChallenge> ArmingGuard::due(std::int64_t now_ns) {
    const std::int64_t age_ns = now_ns - drawn_ns_;
    if (valid_ && age_ns <= kValid_ns) {
        if (age_ns > kValid_ns / 2 || now_ns - sent_ns_ < kRepeat_ns) return std::nullopt;
    } else {
        std::array<std::uint8_t, 8> bytes{};
        if (now_ns < next_ns_ || !key_.random->fill(bytes)) return std::nullopt;
        const auto [low, high] = std::bit_cast<std::array<std::uint32_t, 2>>(bytes);
        challenge_ = {low, high};
        valid_ = true;
        drawn_ns_ = now_ns;
    }
    asked_ = false;
    sent_ns_ = now_ns;
    return challenge_;
}

bool ArmingGuard::accept(const protocol::ArmingAnswer& answer, std::int64_t now_ns) {
    if (!valid_ || now_ns - drawn_ns_ > kValid_ns) return false;
    valid_ = false;
    const auto right = answer_to(challenge_, answer.mode, key_);
    if (right && protocol::same_code(*right, answer)) {
        delay_ns_ = 0;
        return true;
    }
    delay_ns_ = std::clamp(2 * delay_ns_, kFirstDelay_ns, kMostDelay_ns);
    next_ns_ = now_ns + delay_ns_;
    return false;
}

}  // namespace wheelwright::task
