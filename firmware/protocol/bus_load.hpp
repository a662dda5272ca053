// How long frames occupy a CAN bus in the worst case, and which part of the bus a set of periodic frames
// takes. Bit counts include worst-case bit stuffing and the three bits between frames. Real frames are about
// 10 % shorter.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/protocol/codec.hpp"

namespace wheelwright::protocol {

// Bits of a classic frame with `length` = 0..8 data bytes. Of 34 (11-bit id) or 54 (29-bit id) bits and the
// data, every fourth after the first can be followed by a stuff bit (Davis et al., Controller Area Network
// schedulability analysis, 2007); 13 further bits are never stuffed.
constexpr int worst_case_bits(int length, bool extended) {
    const int stuffed = (extended ? 54 : 34) + 8 * length;
    return stuffed + 13 + (stuffed - 1) / 4;
}

// Time on the bus of an FD frame with bit-rate switch, `length` data bytes of an FD size. Approximate: the
// switching points inside two bits and the resynchronisation are neglected (under 1 %).
constexpr double fd_frame_time_s(int length, bool extended, double bit_rate_per_s,
                                 double data_bit_rate_per_s) {
    const int arbitration = extended ? 36 : 17;  // start to bit-rate switch
    const int tail = 12;                         // acknowledge, end of frame, interframe space
    const int data = 5 + 8 * length;             // error state, length code, data
    const int check =
        length > 16 ? 4 + 21 + 7 + 1 : 4 + 17 + 6 + 1;  // stuff count, CRC, fixed stuff bits, delimiter
    const int slow_bits = arbitration + (arbitration - 1) / 4 + tail;
    const int fast_bits = data + data / 4 + check;
    return slow_bits / bit_rate_per_s + fast_bits / data_bit_rate_per_s;
}

struct PeriodicFrame {
    std::string_view name;
    std::uint8_t length = 0;  // classic: 0..8 data bytes
    bool extended = false;
    double period_s = 0;  // 0: sent on events only, takes no part
};

// The message at its own cycle time.
constexpr PeriodicFrame periodic_frame(const MessageInfo& message) {
    return {message.name, message.length, message.extended, message.cycle_time_ms * 1e-3};
}

// Part of the bus that one frame takes, 1 = all of it.
constexpr double load_fraction(const PeriodicFrame& frame, double bit_rate_per_s) {
    return frame.period_s > 0
               ? worst_case_bits(frame.length, frame.extended) / (frame.period_s * bit_rate_per_s)
               : 0.0;
}

constexpr double load_fraction(std::span<const PeriodicFrame> frames, double bit_rate_per_s) {
    double sum = 0;
    for (const PeriodicFrame& frame : frames) {
        sum += load_fraction(frame, bit_rate_per_s);
    }
    return sum;
}

}  // namespace wheelwright::protocol
