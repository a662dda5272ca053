// Authenticated arming without a robot: challenges, answers and delays.
#include "firmware/task/arming_guard.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "firmware/protocol/arming_code.hpp"
#include "tests/support/key_holder.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using protocol::ArmingAnswer;
using protocol::ArmingChallenge;
using protocol::Mode;
using support::KeyHolder;
using task::ArmingGuard;

namespace {

constexpr std::int64_t kMillisecond_ns = 1'000'000;

struct Gate {
    KeyHolder holder;
    ArmingGuard guard{holder.key()};
    std::int64_t now_ns = 5'000'000'000;

    // Until a challenge comes, once each millisecond; after 10 s without one the test fails.
    ArmingChallenge asked() {
        guard.ask();
        for (int i = 0; i < 10'000; ++i, now_ns += kMillisecond_ns) {
            if (const auto challenge = guard.challenge(now_ns)) return *challenge;
        }
        FAIL("no challenge in ten seconds");
        return {};
    }
    bool accepts(const ArmingAnswer& answer) { return guard.accept(answer, now_ns); }
};

bool same(const ArmingChallenge& a, const ArmingChallenge& b) {
    return a.nonce_low == b.nonce_low && a.nonce_high == b.nonce_high;
}

}  // namespace

TEST_GROUP(ArmingGuard){};

TEST(ArmingGuard, takes_the_right_answer_once) {
    Gate gate;
    for (int i = 0; i < 5; ++i) {
        const ArmingChallenge challenge = gate.asked();
        const ArmingAnswer answer = gate.holder.answer(challenge, Mode::velocity);
        CHECK(gate.accepts(answer));
        CHECK_FALSE(gate.accepts(answer));
        gate.now_ns += kMillisecond_ns;
        CHECK_FALSE(gate.accepts(answer));
        CHECK_FALSE(same(gate.asked(), challenge));
        CHECK_FALSE(gate.accepts(answer));  // an old one uses a challenge up like any wrong one
    }
}

// The layout in words, so that a host can be written from it: computed here from the frames' own bytes.
TEST(ArmingGuard, the_code_is_over_one_mode_challenge_and_name) {
    Gate gate;
    const ArmingChallenge challenge = gate.asked();
    std::array<std::uint8_t, 8> sent{};
    CHECK(challenge.encode(sent) == protocol::CodecStatus::ok);
    std::vector<std::uint8_t> text{1, 6};
    text.insert(text.end(), sent.begin(), sent.end());
    for (const char letter : std::string("robot")) text.push_back(static_cast<std::uint8_t>(letter));
    const auto ours = protocol::ArmingText(Mode::trajectory, challenge, "robot");
    CHECK(std::equal(text.begin(), text.end(), ours.bytes().begin(), ours.bytes().end()));

    std::array<std::uint8_t, 16> code{};
    CHECK(gate.holder.key().code->compute(text, code));
    const hal::CanFrame frame = gate.holder.frame(gate.holder.answer(challenge, Mode::trajectory));
    LONGS_EQUAL(8, frame.length);
    LONGS_EQUAL(6, frame.data[1] >> 4U);
    CHECK(std::equal(code.begin(), code.begin() + 6, frame.data.begin() + 2));
    CHECK(gate.accepts(gate.holder.answer(challenge, Mode::trajectory)));
}

TEST(ArmingGuard, refuses_another_key_robot_or_mode_and_every_bit_turned) {
    Gate gate;
    KeyHolder other_key(8);
    KeyHolder other_robot(7, "robo");
    CHECK_FALSE(gate.accepts(other_key.answer(gate.asked(), Mode::torque)));
    CHECK_FALSE(gate.accepts(other_robot.answer(gate.asked(), Mode::torque)));
    for (const Mode mode : protocol::mode_values) {
        if (mode == Mode::torque) continue;
        ArmingAnswer answer = gate.holder.answer(gate.asked(), Mode::torque);
        answer.mode = mode;
        CHECK_FALSE(gate.accepts(answer));
    }
    for (unsigned bit = 0; bit < 48; ++bit) {
        ArmingAnswer answer = gate.holder.answer(gate.asked(), Mode::torque);
        if (bit < 32) answer.code_low ^= 1U << bit;
        if (bit >= 32) answer.code_high = static_cast<std::uint16_t>(answer.code_high ^ 1U << (bit - 32));
        CHECK_FALSE(gate.accepts(answer));
    }
    for (unsigned bit = 0; bit < 64; ++bit) {
        ArmingChallenge challenge = gate.asked();
        if (bit < 32) challenge.nonce_low ^= 1U << bit;
        if (bit >= 32) challenge.nonce_high ^= 1U << (bit - 32);
        CHECK_FALSE(gate.accepts(gate.holder.answer(challenge, Mode::torque)));
    }
    CHECK(gate.accepts(gate.holder.answer(gate.asked(), Mode::torque)));
}

TEST(ArmingGuard, an_answer_is_good_for_a_second) {
    for (const std::int64_t late_ns : {std::int64_t{0}, std::int64_t{1}}) {
        Gate gate;
        const ArmingAnswer answer = gate.holder.answer(gate.asked(), Mode::pose);
        gate.now_ns += ArmingGuard::kValid_ns + late_ns;
        CHECK(gate.accepts(answer) == (late_ns == 0));
    }
}

TEST(ArmingGuard, wrong_answers_delay_the_next_challenge_twice_as_long_each_time_and_never_lock_out) {
    Gate gate;
    const auto delay_s = [&gate] {
        const std::int64_t begin_ns = gate.now_ns;
        gate.asked();
        return 1e-9 * static_cast<double>(gate.now_ns - begin_ns);
    };
    CHECK_FALSE(gate.accepts({}));  // nobody has asked: no guess
    DOUBLES_EQUAL(0, delay_s(), 1e-9);
    for (int i = 0; i < 40; ++i) {
        CHECK_FALSE(gate.accepts({}));
        DOUBLES_EQUAL(std::min(0.1 * std::exp2(i), 3.2), delay_s(), 0.0011);
    }
    CHECK(gate.accepts(gate.holder.answer(gate.asked(), Mode::torque)));
    DOUBLES_EQUAL(0, delay_s(), 1e-9);
    CHECK_FALSE(gate.accepts({}));
    DOUBLES_EQUAL(0.1, delay_s(), 0.0011);
}

// Who asks all the time draws no randomness for it, and takes nobody's challenge away.
TEST(ArmingGuard, a_challenge_stands_until_it_is_answered_or_old_however_often_somebody_asks) {
    Gate gate;
    std::vector<ArmingChallenge> different;
    int sent = 0;
    for (int i = 0; i < 10'000; ++i, gate.now_ns += kMillisecond_ns) {
        gate.guard.ask();
        const auto challenge = gate.guard.challenge(gate.now_ns);
        if (!challenge) continue;
        ++sent;
        if (different.empty() || !same(different.back(), *challenge)) different.push_back(*challenge);
        // Whatever is asked afterwards, the holder has half a second.
        ArmingGuard later = gate.guard;
        for (int wait = 0; wait < 499; ++wait) {
            later.ask();
            later.challenge(gate.now_ns + wait * kMillisecond_ns);
        }
        CHECK(
            later.accept(gate.holder.answer(*challenge, Mode::torque), gate.now_ns + 499 * kMillisecond_ns));
    }
    LONGS_EQUAL(10, different.size());
    CHECK(sent <= 10 * 26);
}

TEST(ArmingGuard, without_entropy_there_is_no_challenge_until_there_is) {
    Gate gate;
    gate.holder.random.empty = true;
    gate.guard.ask();
    for (int i = 0; i < 100; ++i) CHECK_FALSE(gate.guard.challenge(gate.now_ns + i).has_value());
    CHECK_FALSE(gate.accepts(gate.holder.answer({}, Mode::torque)));
    gate.holder.random.empty = false;
    CHECK(gate.accepts(gate.holder.answer(gate.asked(), Mode::torque)));
}

TEST(ArmingGuard, without_a_key_nothing_is_asked_and_no_answer_counts) {
    ArmingGuard guard{task::ArmingKey{}};
    CHECK_FALSE(guard.has_key());
    KeyHolder holder;
    CHECK_FALSE(guard.accept(holder.answer({}, Mode::torque), 1));
}
