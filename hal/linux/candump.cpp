#include "hal/linux/candump.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

namespace wheelwright::hal {
namespace {

constexpr std::uint32_t kErrorFlag = 0x2000'0000;     // CAN_ERR_FLAG
constexpr std::uint32_t kExtendedMask = 0x1FFF'FFFF;  // CAN_EFF_MASK
constexpr std::uint32_t kStandardMask = 0x7FF;
constexpr std::int64_t kLargestSecond = 9'000'000'000;
constexpr std::array<std::uint8_t, 7> kFdLengths{12, 16, 20, 24, 32, 48, 64};

int hex_digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string parse_time(std::string_view text, std::int64_t& time_ns) {
    const std::size_t point = text.find('.');
    if (point == std::string_view::npos || point == 0 || point > 10)
        return "time is not (seconds.microseconds)";
    std::int64_t seconds = 0;
    for (const char c : text.substr(0, point)) {
        if (!is_digit(c)) return "time is not (seconds.microseconds)";
        seconds = seconds * 10 + (c - '0');
    }
    const std::string_view fraction = text.substr(point + 1);
    if (fraction.empty() || fraction.size() > 9) return "time is not (seconds.microseconds)";
    std::int64_t nanoseconds = 0;
    for (std::size_t i = 0; i < 9; ++i) {
        const char c = i < fraction.size() ? fraction[i] : '0';
        if (!is_digit(c)) return "time is not (seconds.microseconds)";
        nanoseconds = nanoseconds * 10 + (c - '0');
    }
    if (seconds > kLargestSecond) return "time is too large";
    time_ns = seconds * 1'000'000'000 + nanoseconds;
    return "";
}

std::string parse_id(std::string_view text, CanFrame& frame) {
    if (text.size() != 3 && text.size() != 8) return "identifier has neither 3 nor 8 hexadecimal digits";
    std::uint32_t id = 0;
    for (const char c : text) {
        const int digit = hex_digit(c);
        if (digit < 0) return "identifier is not hexadecimal";
        id = id << 4U | static_cast<std::uint32_t>(digit);
    }
    if (text.size() == 3) {
        if (id > kStandardMask) return "identifier is above 7FF";
    } else if ((id & kErrorFlag) != 0) {
        frame.error = true;
        id &= ~kErrorFlag;
        if (id > kExtendedMask) return "identifier is above 1FFFFFFF";
    } else {
        frame.extended = true;
        if (id > kExtendedMask) return "identifier is above 1FFFFFFF";
    }
    frame.id = id;
    return "";
}

// Takes bytes off the front of `text`.
std::string take_data(std::string_view& text, std::size_t most, CanFrame& frame) {
    std::size_t count = 0;
    while (!text.empty() && hex_digit(text.front()) >= 0) {
        if (text.size() < 2 || hex_digit(text[1]) < 0) return "data ends in the middle of a byte";
        if (count == most) return "more than " + std::to_string(most) + " data bytes";
        frame.data[count++] = static_cast<std::uint8_t>(hex_digit(text[0]) << 4 | hex_digit(text[1]));
        text.remove_prefix(2);
    }
    frame.length = static_cast<std::uint8_t>(count);
    return "";
}

std::string parse_fd(std::string_view& text, LogFrame& out) {
    const int flags = text.empty() ? -1 : hex_digit(text.front());
    if (flags < 0) return "FD frame without its flags digit";
    text.remove_prefix(1);
    out.frame.fd = true;
    out.fd_flags = static_cast<std::uint8_t>(flags);
    out.frame.bit_rate_switch = (flags & 1) != 0;
    if (out.frame.error) return "an error frame cannot be an FD frame";
    if (std::string failed = take_data(text, 64, out.frame); !failed.empty()) return failed;
    if (out.frame.length > 8 &&
        std::find(kFdLengths.begin(), kFdLengths.end(), out.frame.length) == kFdLengths.end()) {
        return "an FD frame cannot have " + std::to_string(out.frame.length) + " data bytes";
    }
    return "";
}

std::string parse_classic(std::string_view& text, LogFrame& out) {
    if (!text.empty() && (text.front() == 'R' || text.front() == 'r')) {
        out.frame.remote = true;
        text.remove_prefix(1);
        if (!text.empty() && is_digit(text.front())) {
            out.frame.length = static_cast<std::uint8_t>(text.front() - '0');
            if (out.frame.length > 8) return "a remote frame asks for more than 8 bytes";
            text.remove_prefix(1);
        }
    } else if (std::string failed = take_data(text, 8, out.frame); !failed.empty()) {
        return failed;
    }
    if (!text.empty() && text.front() == '_') {
        const int code = text.size() > 1 ? hex_digit(text[1]) : -1;
        if (code < 9 || out.frame.length != 8) return "a length code that is not 9..F behind 8 bytes";
        out.raw_dlc = static_cast<std::uint8_t>(code);
        text.remove_prefix(2);
    }
    return "";
}

}  // namespace

std::string parse_candump_line(std::string_view line, LogFrame& out) {
    while (!line.empty() && (line.back() == '\n' || line.back() == '\r')) line.remove_suffix(1);
    out.frame = {};
    out.fd_flags = 0;
    out.raw_dlc = 0;
    out.suffix.clear();
    const std::size_t close = line.find(')');
    if (!line.starts_with('(') || close == std::string_view::npos) return "does not begin with (time)";
    if (std::string failed = parse_time(line.substr(1, close - 1), out.time_ns); !failed.empty()) {
        return failed;
    }
    line.remove_prefix(close + 1);
    if (!line.starts_with(' ')) return "no space behind the time";
    line.remove_prefix(1);
    const std::size_t space = line.find(' ');
    if (space == 0 || space == std::string_view::npos) return "interface or frame is missing";
    out.interface = line.substr(0, space);
    line.remove_prefix(space + 1);
    const std::size_t mark = line.find('#');
    if (mark == std::string_view::npos) return "no # between identifier and data";
    if (std::string failed = parse_id(line.substr(0, mark), out.frame); !failed.empty()) return failed;
    line.remove_prefix(mark + 1);
    std::string failed;
    if (line.starts_with('#')) {
        line.remove_prefix(1);
        failed = parse_fd(line, out);
    } else {
        failed = parse_classic(line, out);
    }
    if (!failed.empty()) return failed;
    if (!line.empty() && line.front() != ' ') return "data is not hexadecimal";
    out.suffix = line;
    return "";
}

std::string format_candump_line(const LogFrame& entry) {
    const CanFrame& frame = entry.frame;
    std::array<char, 64> head{};
    const std::int64_t microseconds = entry.time_ns / 1000;
    std::snprintf(head.data(), head.size(), "(%010lld.%06lld) ",
                  static_cast<long long>(microseconds / 1'000'000),
                  static_cast<long long>(microseconds % 1'000'000));
    std::string line = head.data() + entry.interface + " ";
    if (frame.extended || frame.error) {
        std::snprintf(head.data(), head.size(), "%08X#", frame.error ? frame.id | kErrorFlag : frame.id);
    } else {
        std::snprintf(head.data(), head.size(), "%03X#", frame.id);
    }
    line += head.data();
    constexpr std::string_view digits = "0123456789ABCDEF";
    if (frame.remote) {
        line += 'R';
        if (frame.length > 0) line += std::to_string(frame.length);
    } else {
        if (frame.fd) {
            const unsigned flags = (entry.fd_flags & 0x0EU) | (frame.bit_rate_switch ? 1U : 0U);
            line += '#';
            line += digits[flags];
        }
        for (std::size_t i = 0; i < frame.length && i < frame.data.size(); ++i) {
            line += digits[frame.data[i] >> 4U];
            line += digits[frame.data[i] & 15U];
        }
    }
    if (entry.raw_dlc > 8) {
        line += '_';
        line += digits[entry.raw_dlc & 15U];
    }
    return line + entry.suffix;
}

}  // namespace wheelwright::hal
