#include "firmware/protocol/command_guard.hpp"

#include <array>
#include <cstdio>
#include <limits>

#include <CppUTest/TestHarness.h>

namespace protocol = wheelwright::protocol;
using protocol::CodecStatus;
using protocol::CommandGuard;
using protocol::CounterCause;

namespace {

constexpr std::int64_t ms = 1'000'000;

struct Frame {
    std::array<std::uint8_t, 8> bytes{};
    std::size_t length = 0;
    std::span<std::uint8_t> span() { return std::span(bytes).first(length); }
};

Frame velocity_frame(std::uint8_t alive) {
    protocol::VelocityCommand command;
    command.forward_speed_m_per_s = 0.35;
    command.yaw_rate_rad_per_s = -0.7;
    Frame frame;
    frame.length = protocol::VelocityCommand::length;
    CHECK(protocol::encode_sealed(command, alive, frame.bytes) == CodecStatus::ok);
    return frame;
}

// The verdict on a velocity command with this counter at this time: -1 accepted, otherwise the cause.
int verdict(CommandGuard& guard, std::uint8_t alive, std::int64_t now_ns) {
    Frame frame = velocity_frame(alive);
    const auto cause = guard.check(protocol::VelocityCommand::id, frame.span(), now_ns);
    return cause ? static_cast<int>(*cause) : -1;
}

constexpr int accepted = -1;
constexpr int stale = static_cast<int>(CounterCause::rejected_alive);

}  // namespace

TEST_GROUP(CommandGuard){};

// By hand: 0x601, mode velocity (4), counter 3. Crc over 03 04 computed bit by bit below.
TEST(CommandGuard, seals_a_frame_as_the_dbc_says) {
    protocol::ModeCommand command;
    command.mode = protocol::Mode::velocity;
    std::array<std::uint8_t, 3> frame{};
    CHECK(protocol::encode_sealed(command, 3, frame) == CodecStatus::ok);
    unsigned crc = 0xFF;
    for (const unsigned byte : {0x03U, 0x04U}) {
        crc ^= byte;
        for (int bit = 0; bit < 8; ++bit) crc = ((crc << 1U) ^ ((crc & 0x80U) != 0 ? 0x11DU : 0U)) & 0x1FFU;
    }
    BYTES_EQUAL(crc ^ 0xFFU, frame[0]);
    BYTES_EQUAL(0x03, frame[1]);
    BYTES_EQUAL(0x04, frame[2]);
    std::printf("ModeCommand velocity, alive 3: 601#%02X%02X%02X\n", frame[0], frame[1], frame[2]);
}

TEST(CommandGuard, sealing_keeps_the_high_nibble_of_byte_1) {
    std::array<std::uint8_t, 8> frame{0x00, 0xAF, 1, 2, 3, 4, 5, 6};
    protocol::seal(frame, 9);
    BYTES_EQUAL(0xA9, frame[1]);
}

TEST(CommandGuard, writes_nothing_when_the_message_cannot_be_encoded) {
    protocol::VelocityCommand command;
    command.forward_speed_m_per_s = std::numeric_limits<double>::quiet_NaN();
    std::array<std::uint8_t, 6> frame{1, 2, 3, 4, 5, 6};
    CHECK(protocol::encode_sealed(command, 0, frame) == CodecStatus::not_finite);
    CHECK((frame == std::array<std::uint8_t, 6>{1, 2, 3, 4, 5, 6}));
}

TEST(CommandGuard, accepts_any_first_counter_but_15) {
    for (std::uint8_t alive = 0; alive < 16; ++alive) {
        CommandGuard guard;
        LONGS_EQUAL(alive < 15 ? accepted : stale, verdict(guard, alive, 0));
    }
}

TEST(CommandGuard, accepts_the_counter_running_round) {
    CommandGuard guard;
    std::uint8_t alive = 0;
    for (int i = 0; i < 40; ++i) {
        LONGS_EQUAL(i % 15, alive);
        LONGS_EQUAL(accepted, verdict(guard, alive, 20 * ms * i));
        alive = protocol::next_alive(alive);
    }
}

TEST(CommandGuard, accepts_any_step_of_the_counter_but_none) {
    for (std::uint8_t first = 0; first < 15; ++first) {
        for (std::uint8_t second = 0; second < 15; ++second) {
            CommandGuard guard;
            verdict(guard, first, 0);
            LONGS_EQUAL(first == second ? stale : accepted, verdict(guard, second, ms));
        }
    }
}

TEST(CommandGuard, refuses_a_repeated_counter_for_500_ms_and_no_longer) {
    for (const std::int64_t start_ns : {std::int64_t{0}, std::int64_t{7'123'456'789}}) {
        CommandGuard guard;
        LONGS_EQUAL(accepted, verdict(guard, 5, start_ns));
        LONGS_EQUAL(stale, verdict(guard, 5, start_ns));
        LONGS_EQUAL(stale, verdict(guard, 5, start_ns + 500 * ms - 1));
        LONGS_EQUAL(stale, verdict(guard, 5, start_ns + 500 * ms));
        LONGS_EQUAL(accepted, verdict(guard, 5, start_ns + 500 * ms + 1));
        LONGS_EQUAL(stale, verdict(guard, 5, start_ns + 501 * ms));
    }
}

TEST(CommandGuard, a_refused_frame_does_not_prolong_the_memory) {
    CommandGuard guard;
    LONGS_EQUAL(accepted, verdict(guard, 5, 0));
    for (int i = 1; i < 500; ++i) LONGS_EQUAL(stale, verdict(guard, 5, i * ms));
    LONGS_EQUAL(accepted, verdict(guard, 5, 500 * ms + 1));
}

TEST(CommandGuard, time_that_runs_backwards_counts_as_none) {
    CommandGuard guard;
    LONGS_EQUAL(accepted, verdict(guard, 5, 10'000 * ms));
    LONGS_EQUAL(stale, verdict(guard, 5, 9'000 * ms));
    LONGS_EQUAL(accepted, verdict(guard, 6, 9'000 * ms));
}

TEST(CommandGuard, keeps_a_counter_for_each_message) {
    CommandGuard guard;
    LONGS_EQUAL(accepted, verdict(guard, 5, 0));
    protocol::TorqueCommand torque;
    std::array<std::uint8_t, 6> frame{};
    CHECK(protocol::encode_sealed(torque, 5, frame) == CodecStatus::ok);
    CHECK(!guard.check(protocol::TorqueCommand::id, frame, 0));
    CHECK(guard.check(protocol::TorqueCommand::id, frame, 0) == CounterCause::rejected_alive);
}

TEST(CommandGuard, names_length_before_crc_before_counter) {
    CommandGuard guard;
    Frame frame = velocity_frame(5);
    CHECK(!guard.check(protocol::VelocityCommand::id, frame.span(), 0));
    frame.bytes[0] ^= 1U;  // counter repeated and Crc wrong
    CHECK(guard.check(protocol::VelocityCommand::id, frame.span(), 0) == CounterCause::rejected_crc);
    for (const std::size_t length : {std::size_t{0}, std::size_t{1}, std::size_t{5}, std::size_t{7}}) {
        frame.length = length;
        CHECK(guard.check(protocol::VelocityCommand::id, frame.span(), 0) == CounterCause::rejected_length);
    }
}

TEST(CommandGuard, a_frame_with_any_bit_flipped_is_refused_and_changes_nothing) {
    for (unsigned bit = 0; bit < 48; ++bit) {
        CommandGuard guard;
        Frame frame = velocity_frame(5);
        frame.bytes.at(bit / 8) ^= static_cast<std::uint8_t>(1U << (bit % 8));
        CHECK(guard.check(protocol::VelocityCommand::id, frame.span(), 0) == CounterCause::rejected_crc);
        LONGS_EQUAL(accepted, verdict(guard, 5, 0));
    }
}

// Every 11-bit id and an extended one: what is not a sealed command passes with any content; a sealed one
// never.
TEST(CommandGuard, judges_sealed_commands_and_nothing_else) {
    CommandGuard guard;
    const std::array<std::uint8_t, 1> rubbish{0xA5};
    int judged = 0;
    for (std::uint32_t id = 0; id < 0x800; ++id) {
        judged += guard.check(id, rubbish, 0) ? 1 : 0;
    }
    judged += guard.check(0x1FFF'F602, rubbish, 0) ? 1 : 0;
    LONGS_EQUAL(13, judged);
    CHECK(!guard.check(protocol::EmergencyStop::id, rubbish, 0));
    CHECK(!guard.check(protocol::EmergencyStop::id, {}, 0));
}

TEST(CommandGuard, names_the_counter_of_what_decode_refuses) {
    using protocol::rejection_cause;
    const std::uint32_t velocity = protocol::VelocityCommand::id;
    CHECK(rejection_cause(CodecStatus::wrong_length, velocity) == CounterCause::rejected_length);
    CHECK(rejection_cause(CodecStatus::not_finite, velocity) == CounterCause::rejected_not_finite);
    CHECK(rejection_cause(CodecStatus::out_of_range, velocity) == CounterCause::rejected_range);
    CHECK(rejection_cause(CodecStatus::unknown_value, protocol::PoseGoal::id) ==
          CounterCause::rejected_range);
    CHECK(rejection_cause(CodecStatus::unknown_value, protocol::ModeCommand::id) ==
          CounterCause::rejected_unknown_mode);
    CHECK(rejection_cause(CodecStatus::out_of_range, protocol::ModeCommand::id) ==
          CounterCause::rejected_unknown_mode);
}

TEST(CommandGuard, sealing_replaces_the_counter_and_leaves_its_byte_s_other_half) {
    for (std::uint8_t alive = 0; alive < 15; ++alive) {
        std::array<std::uint8_t, 2> frame{0xAA, 0x5F};  // the shortest that can be sealed
        protocol::seal(frame, alive);
        BYTES_EQUAL(0x50 | alive, frame[1]);
        BYTES_EQUAL(protocol::seal_crc(frame), frame[0]);
    }
}

TEST(CommandGuard, sealing_ignores_what_the_message_says_of_seal_and_counter) {
    protocol::TorqueCommand clean, dirty;
    dirty.alive = 255;  // no counter
    dirty.crc = 255;
    std::array<std::uint8_t, 6> frame{}, other{};
    CHECK(protocol::encode_sealed(clean, 7, frame) == CodecStatus::ok);
    CHECK(protocol::encode_sealed(dirty, 7, other) == CodecStatus::ok);
    CHECK(frame == other);
}

TEST(CommandGuard, the_shortest_sealed_frame_passes) {
    CommandGuard guard;
    std::array<std::uint8_t, protocol::ClearFault::length> frame{};
    CHECK(protocol::encode_sealed(protocol::ClearFault{}, 3, frame) == CodecStatus::ok);
    CHECK(!guard.check(protocol::ClearFault::id, frame, 0));
    CHECK(guard.check(protocol::ClearFault::id, std::span(frame).first(1), 0) ==
          CounterCause::rejected_length);
}
