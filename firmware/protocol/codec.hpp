// What the headers generated from DBC files share. toolchain/dbc_codegen/generate.py writes one struct per
// message:
//
//     struct TorqueCommand {
//         static constexpr std::string_view name, sender;     // as in the DBC
//         static constexpr std::uint32_t id;                  // `command` in the motor drives' headers
//         static constexpr std::uint8_t length;               // data bytes
//         static constexpr bool extended;                     // 29-bit id
//         static constexpr std::uint16_t cycle_time_ms;       // 0: event driven
//         static constexpr bool sealed;                       // carries Crc and Alive, see command_guard.hpp
//         double left_torque_Nm{};                            // one field per signal, in physical units
//         static constexpr double left_torque_Nm_min, left_torque_Nm_max, left_torque_Nm_step;
//
//         // Writes `length` bytes to the front of `out`; on any error writes nothing. A value is in
//         // range when the nearest representable one is; exact ties are rounded away from zero.
//         [[nodiscard]] constexpr CodecStatus encode(std::span<std::uint8_t> out) const;
//
//         // Reads a whole frame; on any error leaves `out` as it was. Bits no signal covers are ignored.
//         [[nodiscard]] static constexpr CodecStatus decode(std::span<const std::uint8_t> bytes,
//                                                           TorqueCommand& out);
//
//         // Brings each scaled field into its range; true when one was outside. For telemetry, which
//         // is better at its limit than missing. Not finite values stay, and encode refuses them.
//         constexpr bool saturate();                          // only where there is something to saturate
//
//         // Calls visit(FieldInfo, field) for each field in order. Self may be const.
//         template <typename Self, typename Visitor>
//         static constexpr void for_each_field(Self& self, Visitor&& visit);
//     };
//
// for each value table an enum class with <name>_values, is_known() and to_string_view(), and for all
// messages AllMessages (a type list) and all_messages (a table).
//
// Nothing here allocates, throws, blocks or has state. Cost in instructions, measured with callgrind at -O3:
// BodyState (4 scaled fields) encodes in 63, Status (20 fields) in 121, two floats in 18; PoseGoal decodes
// in 46.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>

namespace wheelwright::protocol {

enum class CodecStatus : std::uint8_t {
    ok,
    wrong_length,   // decode: not the message's length; encode: less room than the message needs
    not_finite,     // a NaN or an infinite value
    out_of_range,   // outside the signal's range
    unknown_value,  // a number its value table does not name
};

constexpr std::string_view to_string_view(CodecStatus status) {
    switch (status) {
        case CodecStatus::ok:
            return "ok";
        case CodecStatus::wrong_length:
            return "wrong_length";
        case CodecStatus::not_finite:
            return "not_finite";
        case CodecStatus::out_of_range:
            return "out_of_range";
        case CodecStatus::unknown_value:
            return "unknown_value";
    }
    return "unknown";
}

// A field as for_each_field shows it.
struct FieldInfo {
    std::string_view name;    // of the C++ field
    std::string_view signal;  // of the DBC signal; for a multiplexed value, of the first branch
    std::string_view unit;    // of the DBC signal
    double minimum;
    double maximum;
    double step;  // physical value of one bit; 0 for floats
};

// A message as bus-load computation and log tools need it.
struct MessageInfo {
    std::uint32_t id;
    std::uint8_t length;
    bool extended;
    std::uint16_t cycle_time_ms;  // 0: event driven
    bool sealed;
    std::string_view name;
    std::string_view sender;
};

template <typename... Messages>
struct MessageList {
    // Calls visit.template operator()<Message>() for each message in order.
    template <typename Visitor>
    static constexpr void for_each(Visitor&& visit) {
        (visit.template operator()<Messages>(), ...);
    }
};

// Used by the generated code only. `bits` holds a frame's bytes as one number, byte 0 lowest.
namespace codec {

template <std::size_t length>
constexpr std::uint64_t load(std::span<const std::uint8_t> bytes) {
    return [&]<std::size_t... index>(std::index_sequence<index...>) {
        return ((static_cast<std::uint64_t>(bytes[index]) << (8U * index)) | ... | std::uint64_t{0});
    }(std::make_index_sequence<length>{});
}

// As load, for frames that may be shorter or longer than the message: missing bytes are 0.
template <std::size_t length>
constexpr std::uint64_t load_short(std::span<const std::uint8_t> bytes) {
    std::uint64_t bits = 0;
    for (std::size_t index = 0; index < length && index < bytes.size(); ++index) {
        bits |= static_cast<std::uint64_t>(bytes[index]) << (8U * index);
    }
    return bits;
}

template <std::size_t length>
constexpr void store(std::uint64_t bits, std::span<std::uint8_t> out) {
    [&]<std::size_t... index>(std::index_sequence<index...>) {
        ((out[index] = static_cast<std::uint8_t>(bits >> (8U * index))), ...);
    }(std::make_index_sequence<length>{});
}

template <unsigned start, unsigned size, bool is_signed>
constexpr std::int64_t extract(std::uint64_t bits) {
    static_assert(size >= 1 && start + size <= 64);
    const std::uint64_t top_aligned = bits << (64U - start - size);
    if constexpr (is_signed) {
        return static_cast<std::int64_t>(top_aligned) >> (64U - size);
    } else {
        return static_cast<std::int64_t>(top_aligned >> (64U - size));
    }
}

template <unsigned start, unsigned size>
constexpr std::uint64_t place(std::int64_t raw) {
    static_assert(size >= 1 && start + size <= 64);
    return (static_cast<std::uint64_t>(raw) << (64U - size)) >> (64U - start - size);
}

constexpr bool is_finite(double value) {
    constexpr std::uint64_t exponent = 0x7FF0'0000'0000'0000U;
    return (std::bit_cast<std::uint64_t>(value) & exponent) != exponent;
}

constexpr bool is_finite(float value) {
    constexpr std::uint32_t exponent = 0x7F80'0000U;
    return (std::bit_cast<std::uint32_t>(value) & exponent) != exponent;
}

// raw = value/step rounded to nearest, when that lies in lowest..highest, which contains 0 (the generator
// checks).
constexpr CodecStatus quantise(double value, double step, std::int64_t lowest, std::int64_t highest,
                               std::int64_t& raw) {
    const double scaled = value / step;
    const double rounded = scaled < 0 ? scaled - 0.5 : scaled + 0.5;  // the conversion cuts towards zero
    if (!(rounded > static_cast<double>(lowest) - 1.0 && rounded < static_cast<double>(highest) + 1.0)) {
        return is_finite(value) ? CodecStatus::out_of_range : CodecStatus::not_finite;
    }
    raw = static_cast<std::int64_t>(rounded);
    return CodecStatus::ok;
}

constexpr CodecStatus check_float(float value) {
    return is_finite(value) ? CodecStatus::ok : CodecStatus::not_finite;
}

constexpr CodecStatus check_float(float value, float minimum, float maximum) {
    if (value >= minimum && value <= maximum) return CodecStatus::ok;
    return is_finite(value) ? CodecStatus::out_of_range : CodecStatus::not_finite;
}

// True when the value was outside and has been moved to the nearer limit. NaN stays.
template <typename Real>
constexpr bool saturate_value(Real& value, Real minimum, Real maximum) {
    if (value < minimum) {
        value = minimum;
        return true;
    }
    if (value > maximum) {
        value = maximum;
        return true;
    }
    return false;
}

}  // namespace codec
}  // namespace wheelwright::protocol
