// What compare_with_canmatrix.py cannot see: errors, borders, atomicity, and that all of it works at compile
// time.
#include <array>
#include <bit>
#include <limits>
#include <string_view>
#include <type_traits>

#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

#include <CppUTest/TestHarness.h>

namespace protocol = wheelwright::protocol;
namespace odrive_0_5 = wheelwright::drivers::odrive_0_5;
namespace odrive_0_6 = wheelwright::drivers::odrive_0_6;
using protocol::CodecStatus;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

CodecStatus encode_speed(double speed_m_per_s, int* raw = nullptr) {
    protocol::VelocityCommand command;
    command.forward_speed_m_per_s = speed_m_per_s;
    std::array<std::uint8_t, 8> bytes{};
    bytes.fill(0xEE);
    const CodecStatus status = command.encode(bytes);
    if (status != CodecStatus::ok) {
        for (const std::uint8_t byte : bytes) BYTES_EQUAL(0xEE, byte);  // nothing was written
    } else {
        BYTES_EQUAL(0xEE, bytes[6]);  // nothing behind the message
        if (raw != nullptr) *raw = static_cast<std::int16_t>(bytes[2] | bytes[3] << 8);
    }
    return status;
}

struct CheckTable {
    std::size_t index = 0;

    template <typename M>
    void operator()() {
        const protocol::MessageInfo& info = protocol::all_messages.at(index);
        LONGS_EQUAL(M::id, info.id);
        LONGS_EQUAL(M::length, info.length);
        LONGS_EQUAL(M::cycle_time_ms, info.cycle_time_ms);
        CHECK(M::extended == info.extended && M::sealed == info.sealed);
        CHECK(M::name == info.name && M::sender == info.sender);
        CHECK(std::is_trivially_copyable_v<M>);
        ++index;
    }
};

}  // namespace

TEST_GROUP(Generated){};

TEST(Generated, encodes_and_decodes_at_compile_time) {
    constexpr auto bytes = [] {
        protocol::WheelState state;
        state.left_speed_rad_per_s = -1.5;  // -300 steps of 0.005
        state.right_torque_Nm = 4.999;
        std::array<std::uint8_t, 8> out{};
        return state.encode(out) == CodecStatus::ok ? out : std::array<std::uint8_t, 8>{};
    }();
    static_assert(bytes == std::array<std::uint8_t, 8>{0xD4, 0xFE, 0, 0, 0, 0, 0x87, 0x13});
    constexpr double back = [](auto frame) {
        protocol::WheelState state;
        return protocol::WheelState::decode(frame, state) == CodecStatus::ok ? state.left_speed_rad_per_s
                                                                             : nan;
    }(bytes);
    static_assert(back == -1.5);
}

TEST(Generated, rounds_to_the_nearest_value_and_ties_away_from_zero) {
    int raw = 0;
    CHECK(encode_speed(0.00074, &raw) == CodecStatus::ok);
    LONGS_EQUAL(1, raw);
    CHECK(encode_speed(-0.00076, &raw) == CodecStatus::ok);
    LONGS_EQUAL(-2, raw);
    CHECK(encode_speed(0.00025, &raw) == CodecStatus::ok);  // 0.00025 is a little more than half of 0.0005
    LONGS_EQUAL(1, raw);
    CHECK(encode_speed(-0.0, &raw) == CodecStatus::ok);
    LONGS_EQUAL(0, raw);
}

TEST(Generated, encodes_up_to_the_borders_of_the_range_and_not_beyond) {
    const double border = protocol::VelocityCommand::forward_speed_m_per_s_max;
    const double step = protocol::VelocityCommand::forward_speed_m_per_s_step;
    DOUBLES_EQUAL(16.3835, border, 0);
    int raw = 0;
    for (const double sign : {1.0, -1.0}) {
        CHECK(encode_speed(sign * border, &raw) == CodecStatus::ok);
        LONGS_EQUAL(sign * 32767, raw);
        CHECK(encode_speed(sign * (border + 0.49 * step), &raw) == CodecStatus::ok);
        LONGS_EQUAL(sign * 32767, raw);
        CHECK(encode_speed(sign * (border + 0.51 * step)) == CodecStatus::out_of_range);
        CHECK(encode_speed(sign * 1e300) == CodecStatus::out_of_range);
        CHECK(encode_speed(sign * infinity) == CodecStatus::not_finite);
        CHECK(encode_speed(sign * nan) == CodecStatus::not_finite);
    }
}

TEST(Generated, unsigned_values_start_at_zero) {
    protocol::TrajectoryCommand command;
    std::array<std::uint8_t, 8> bytes{};
    command.length_m = -0.0004;
    CHECK(command.encode(bytes) == CodecStatus::ok);
    command.length_m = -0.0006;
    CHECK(command.encode(bytes) == CodecStatus::out_of_range);
}

TEST(Generated, decode_refuses_what_lies_outside_the_range_and_leaves_the_output) {
    protocol::VelocityCommand command;
    command.forward_speed_m_per_s = 1.25;
    command.alive = 7;
    const std::array<std::uint8_t, 6> too_low{0, 0, 0x00, 0x80, 0, 0};  // -32768 is outside -32767..32767
    CHECK(protocol::VelocityCommand::decode(too_low, command) == CodecStatus::out_of_range);
    const std::array<std::uint8_t, 6> counter_15{0, 15, 0, 0, 0, 0};
    CHECK(protocol::VelocityCommand::decode(counter_15, command) == CodecStatus::out_of_range);
    DOUBLES_EQUAL(1.25, command.forward_speed_m_per_s, 0);
    LONGS_EQUAL(7, command.alive);
}

TEST(Generated, ignores_bits_no_signal_covers) {
    protocol::VelocityCommand command;
    const std::array<std::uint8_t, 6> bytes{0, 0xF3, 2, 0, 0, 0};
    CHECK(protocol::VelocityCommand::decode(bytes, command) == CodecStatus::ok);
    LONGS_EQUAL(3, command.alive);
    DOUBLES_EQUAL(0.001, command.forward_speed_m_per_s, 1e-15);
}

TEST(Generated, lengths_are_exact_unless_the_dbc_says_otherwise) {
    const std::array<std::uint8_t, 64> bytes{};
    for (std::size_t n = 0; n <= 64; ++n) {
        const std::span<const std::uint8_t> frame = std::span(bytes).first(n);
        protocol::VelocityCommand velocity;
        CHECK((protocol::VelocityCommand::decode(frame, velocity) == CodecStatus::ok) == (n == 6));
        protocol::EmergencyStop stop;
        CHECK(protocol::EmergencyStop::decode(frame, stop) == CodecStatus::ok);
        odrive_0_6::TxSdo reply;
        CHECK((odrive_0_6::TxSdo::decode(frame, reply) == CodecStatus::ok) == (n >= 5));
    }
}

TEST(Generated, missing_bytes_of_a_short_frame_are_zero) {
    const std::array<std::uint8_t, 5> bytes{0, 0x34, 0x12, 0, 1};  // endpoint 0x1234, a bool that is true
    odrive_0_6::TxSdo reply;
    CHECK(odrive_0_6::TxSdo::decode(bytes, reply) == CodecStatus::ok);
    LONGS_EQUAL(0x1234, reply.endpoint_id);
    LONGS_EQUAL(1, reply.value);
}

TEST(Generated, encode_needs_room) {
    std::array<std::uint8_t, 5> small{};
    CHECK(protocol::VelocityCommand{}.encode(small) == CodecStatus::wrong_length);
    CHECK(protocol::EmergencyStop{}.encode({}) == CodecStatus::ok);
}

TEST(Generated, floats_must_be_finite_and_in_range_both_ways) {
    const std::array<std::uint32_t, 5> not_finite{0x7F80'0000U, 0xFF80'0000U, 0x7FC0'0000U, 0xFFC0'0001U,
                                                  0x7F80'0001U};
    for (const std::uint32_t word : not_finite) {
        protocol::ParameterRequest request;
        request.value = std::bit_cast<float>(word);
        std::array<std::uint8_t, 8> bytes{};
        CHECK(request.encode(bytes) == CodecStatus::not_finite);
        for (unsigned i = 0; i < 4; ++i) bytes.at(4 + i) = static_cast<std::uint8_t>(word >> (8 * i));
        CHECK(protocol::ParameterRequest::decode(bytes, request) == CodecStatus::not_finite);
    }
    protocol::StandardErrorK5K7 error;
    std::array<std::uint8_t, 8> bytes{};
    error.k7_per_kg_m = std::numeric_limits<float>::max();
    CHECK(error.encode(bytes) == CodecStatus::out_of_range);
    error.k7_per_kg_m = -1e-6F;
    CHECK(error.encode(bytes) == CodecStatus::out_of_range);
    error.k7_per_kg_m = 0;
    CHECK(error.encode(bytes) == CodecStatus::ok);
}

TEST(Generated, enumerations_are_closed_unless_the_dbc_says_otherwise) {
    unsigned highest = 0;  // that may be asked for; lower than the table's end
    const protocol::ModeCommand any;
    protocol::ModeCommand::for_each_field(any, [&](const protocol::FieldInfo& field, const auto&) {
        if (field.name == "mode") highest = static_cast<unsigned>(field.maximum);
    });
    CHECK(highest >= 7);
    for (unsigned mode = 0; mode < 256; ++mode) {
        const std::array<std::uint8_t, 3> bytes{0, 0, static_cast<std::uint8_t>(mode)};
        protocol::ModeCommand command;
        const CodecStatus expected = mode >= protocol::mode_values.size() ? CodecStatus::unknown_value
                                     : mode == 0 || mode > highest        ? CodecStatus::out_of_range
                                                                          : CodecStatus::ok;
        CHECK(protocol::ModeCommand::decode(bytes, command) == expected);
        command.mode = static_cast<protocol::Mode>(mode);
        std::array<std::uint8_t, 3> out{};
        CHECK(command.encode(out) == expected);
    }
    const std::array<std::uint8_t, 8> heartbeat{0, 8, 0, 0, 99, 0, 0, 0};
    odrive_0_5::Heartbeat beat;
    CHECK(odrive_0_5::Heartbeat::decode(heartbeat, beat) == CodecStatus::ok);
    LONGS_EQUAL(99, static_cast<int>(beat.axis_state));
    CHECK(!is_known(beat.axis_state));
    CHECK((beat.axis_error & odrive_0_5::AxisError::watchdog_timer_expired) != 0);
}

// A 32-bit signal with a small table: no value may be mistaken for another by losing its upper bits.
TEST(Generated, wide_enumerations_are_compared_whole) {
    const std::array<std::uint8_t, 4> alias{8, 1, 0, 0};
    odrive_0_6::SetAxisState command;
    CHECK(odrive_0_6::SetAxisState::decode(alias, command) == CodecStatus::unknown_value);
}

TEST(Generated, enumerations_know_their_names) {
    STRCMP_EQUAL("figure_eight", to_string_view(protocol::TrajectoryShape::figure_eight).data());
    const auto beyond = static_cast<protocol::Mode>(unsigned(protocol::mode_values.back()) + 1);
    STRCMP_EQUAL("unknown", to_string_view(beyond).data());
    CHECK_FALSE(is_known(beyond));
    STRCMP_EQUAL("closed_loop_control", to_string_view(odrive_0_6::AxisState::closed_loop_control).data());
    for (const protocol::Mode mode : protocol::mode_values) CHECK(to_string_view(mode) != "unknown");
    // A value that was taken out leaves its number unknown and the others as they were.
    CHECK_FALSE(is_known(static_cast<protocol::Blocker>(7)));
    LONGS_EQUAL(6, static_cast<int>(protocol::Blocker::model_not_trusted));
    LONGS_EQUAL(11, static_cast<int>(protocol::Blocker::design_refused));
}

TEST(Generated, saturation_moves_scaled_values_to_their_limits) {
    protocol::Timing timing;
    timing.execution_max_us = 70'000;
    timing.wake_latency_max_us = -3;
    timing.wake_latency_last_us = 12;
    CHECK(timing.saturate());
    DOUBLES_EQUAL(65535, timing.execution_max_us, 0);
    DOUBLES_EQUAL(0, timing.wake_latency_max_us, 0);
    DOUBLES_EQUAL(12, timing.wake_latency_last_us, 0);
    CHECK(!timing.saturate());
    timing.execution_max_us = nan;
    CHECK(!timing.saturate());
    std::array<std::uint8_t, 8> bytes{};
    CHECK(timing.encode(bytes) == CodecStatus::not_finite);
}

TEST(Generated, a_multiplexed_message_carries_the_counter_its_cause_names) {
    protocol::Counters counters;
    counters.cause = protocol::CounterCause::missed_cycles;
    counters.value = 0x89AB'CDEF;
    std::array<std::uint8_t, 5> bytes{};
    CHECK(counters.encode(bytes) == CodecStatus::ok);
    CHECK((bytes == std::array<std::uint8_t, 5>{8, 0xEF, 0xCD, 0xAB, 0x89}));
}

TEST(Generated, the_table_of_messages_agrees_with_the_structs) {
    CheckTable check;
    protocol::AllMessages::for_each(check);
    LONGS_EQUAL(protocol::all_messages.size(), check.index);
}

TEST(Generated, commands_that_move_the_robot_are_sealed) {
    for (const protocol::MessageInfo& message : protocol::all_messages) {
        const bool command = message.sender == "Host" && message.name != "EmergencyStop";
        CHECK(message.sealed == command);
        CHECK(message.id >= 0x600 && !message.extended);
    }
}
