// Protection of the commands that can move the robot. Such a "sealed" frame carries
//     byte 0                 Crc, CRC-8 SAE J1850 over bytes 1 to the last, in order
//     byte 1, low nibble     Alive, a counter 0..14
// A sender seals each frame; the firmware passes each command frame through one CommandGuard before decoding
// it. Nothing here allocates, throws or reads a clock.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware/protocol/crc8.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::protocol {

inline constexpr std::uint8_t alive_count = 15;               // counters run 0..14
inline constexpr std::int64_t alive_window_ns = 500'000'000;  // how long an accepted counter is remembered

// The counter that follows `alive`.
constexpr std::uint8_t next_alive(std::uint8_t alive) {
    return static_cast<std::uint8_t>(alive + 1U < alive_count ? alive + 1U : 0U);
}

constexpr std::uint8_t seal_crc(std::span<const std::uint8_t> frame) {
    return crc8_sae_j1850(frame.subspan(1));
}

// Writes Alive and then Crc into an encoded frame. `frame` is exactly the message's bytes, two or more (fewer
// are left as they are). Alive above 14 is written as it is: the guard will reject it.
constexpr void seal(std::span<std::uint8_t> frame, std::uint8_t alive) {
    if (frame.size() < 2) return;
    frame[1] = static_cast<std::uint8_t>((frame[1] & 0xF0U) | (alive & 0x0FU));
    frame[0] = seal_crc(frame);
}

// Encodes and seals a message; its own crc and alive fields are ignored. Errors as encode, and then nothing
// is written.
template <typename Message>
    requires(Message::sealed)
[[nodiscard]] constexpr CodecStatus encode_sealed(Message message, std::uint8_t alive,
                                                  std::span<std::uint8_t> out) {
    message.crc = 0;
    message.alive = 0;
    const CodecStatus status = message.encode(out);
    if (status == CodecStatus::ok) {
        seal(out.first(Message::length), alive);
    }
    return status;
}

// The counter that a frame refused by decode() belongs to.
constexpr CounterCause rejection_cause(CodecStatus status, std::uint32_t id) {
    switch (status) {
        case CodecStatus::wrong_length:
            return CounterCause::rejected_length;
        case CodecStatus::not_finite:
            return CounterCause::rejected_not_finite;
        case CodecStatus::ok:
        case CodecStatus::out_of_range:
        case CodecStatus::unknown_value:
            break;
    }
    return id == ModeCommand::id ? CounterCause::rejected_unknown_mode : CounterCause::rejected_range;
}

// Remembers, for each sealed command, the last accepted counter and when it came. A frame is accepted when
// its counter differs from the last one accepted in the past 500 ms (at exactly 500 ms it is still
// remembered). A refused frame changes nothing. The verdict is a function of (frames so far, time) alone.
class CommandGuard {
  public:
    // Nothing: the frame may be decoded. Otherwise the counter to increase: rejected_length, rejected_crc or
    // rejected_alive, checked in this order. `now_ns` is when the frame was received, on any monotonic time
    // base; time that seems to run backwards counts as no time passed. Ids of messages that are not sealed
    // (EmergencyStop, telemetry, foreign frames) always pass. Cost: about 40 instructions.
    [[nodiscard]] constexpr std::optional<CounterCause> check(std::uint32_t id,
                                                              std::span<const std::uint8_t> frame,
                                                              std::int64_t now_ns) {
        const std::size_t slot = id - first_id;
        if (id < first_id || slot >= sealed_lengths.size()) return std::nullopt;
        // The lower bound follows from the table; said again so that compilers see it too.
        if (frame.size() < 2 || frame.size() != sealed_lengths[slot]) return CounterCause::rejected_length;
        if (frame[0] != seal_crc(frame)) return CounterCause::rejected_crc;
        const auto alive = static_cast<std::uint8_t>(frame[1] & 0x0FU);
        if (alive >= alive_count) return CounterCause::rejected_alive;
        Last& last = last_[slot];
        if (last.alive == alive && now_ns - last.time_ns <= alive_window_ns)
            return CounterCause::rejected_alive;
        last = {alive, now_ns};
        return std::nullopt;
    }

  private:
    static constexpr std::uint8_t never = 0xFF;

    struct Last {
        std::uint8_t alive = never;
        std::int64_t time_ns = 0;
    };

    static constexpr std::size_t sealed_count = static_cast<std::size_t>(std::count_if(
        all_messages.begin(), all_messages.end(), [](const MessageInfo& m) { return m.sealed; }));

    // Sealed messages have consecutive ids, so that finding one is a subtraction.
    static constexpr std::uint32_t first_id =
        std::find_if(all_messages.begin(), all_messages.end(), [](const MessageInfo& m) {
            return m.sealed;
        })->id;
    static constexpr std::array<std::uint8_t, sealed_count> sealed_lengths = [] {
        std::array<std::uint8_t, sealed_count> lengths{};
        for (const MessageInfo& message : all_messages) {
            if (message.sealed) lengths.at(message.id - first_id) = message.length;
        }
        return lengths;
    }();
    static_assert(std::all_of(sealed_lengths.begin(), sealed_lengths.end(),
                              [](std::uint8_t n) { return n >= 2; }),
                  "sealed messages must have consecutive ids and at least two bytes");

    std::array<Last, sealed_count> last_{};
};

}  // namespace wheelwright::protocol
