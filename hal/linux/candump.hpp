// One line of candump -L, our log format:
//   (1436509052.249713) can0 624#2C01F4012C01F401        classic data frame, 3 or 8 digits of identifier
//   (1436509052.249714) can0 123#R4                      remote frame, asking for 4 bytes
//   (1436509052.249715) can0 123##1AABB                  FD frame, first digit: flags (1 bit-rate switch)
//   (1436509052.249716) can0 20000080#0000000000000000   error frame
// Sources: can-utils lib.c (sprint_canframe), Linux include/uapi/linux/can.h.
// A line that candump wrote is written back with the same bytes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "hal/can_bus.hpp"

namespace wheelwright::hal {

struct LogFrame {
    std::int64_t time_ns = 0;
    std::string interface = "can0";
    CanFrame frame;
    std::uint8_t fd_flags = 0;  // FD: as in the log; bit 0 is frame.bit_rate_switch
    std::uint8_t raw_dlc = 0;   // classic with 8 bytes: length code 9..15 where one was sent, else 0
    std::string suffix;         // what follows the frame (" R" or " T" with -x, then what others add)
};

// "" when the line is good, else what is wrong with it; `out` is then undefined. A trailing CR or LF is
// ignored.
std::string parse_candump_line(std::string_view line, LogFrame& out);

// The line without its newline. Times finer than a microsecond are cut, as candump has six digits.
std::string format_candump_line(const LogFrame& entry);

}  // namespace wheelwright::hal
