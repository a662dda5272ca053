// Reader and writer of candump -L lines, our log format:
//   (1436509052.249713) can0 624#2C01F4012C01F401        classic data frame, 3 or 8 digits of identifier
//   (1436509052.249714) can0 123#R4                      remote frame, asking for 4 bytes
//   (1436509052.249715) can0 123##1AABB                  FD frame, first digit: flags (1 bit-rate switch)
//   (1436509052.249716) can0 20000080#0000000000000000   error frame
// Sources: can-utils lib.c (sprint_canframe), Linux include/uapi/linux/can.h.
// A line that candump wrote is written back with the same bytes.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hal/can_bus.hpp"

namespace wheelwright::tools {

struct LogFrame {
    std::int64_t time_ns = 0;
    std::string interface = "can0";
    hal::CanFrame frame;
    std::uint8_t fd_flags = 0;  // FD: as in the log; bit 0 is frame.bit_rate_switch
    std::uint8_t raw_dlc = 0;   // classic with 8 bytes: length code 9..15 where one was sent, else 0
    std::string suffix;         // what follows the frame (" R" or " T" with -x)
};

// "" when the line is good, else what is wrong with it; `out` is then undefined. A trailing CR or LF is
// ignored.
std::string parse_candump_line(std::string_view line, LogFrame& out);

// The line without its newline. Times finer than a microsecond are cut, as candump has six digits.
std::string format_candump_line(const LogFrame& entry);

// Something wrong with a line of a log.
struct LineProblem {
    std::size_t line = 0;  // from 1; 0: the whole file
    std::string message;
};

std::string to_text(const std::string& file, const LineProblem& problem);

// Whether a file begins as a candump -L log does, with '('; nothing if it cannot be opened (errno says why).
std::optional<bool> is_candump(const std::string& path);

// Reads a log line by line. Lines must not go back in time; equal times are fine. Blank lines are skipped.
class CandumpReader {
  public:
    // `in` outlives the reader.
    explicit CandumpReader(std::istream& in) : in_(in) {}

    enum class Next : std::uint8_t { frame, bad_line, end };
    Next next(LogFrame& out);

    // After bad_line.
    const LineProblem& problem() const { return problem_; }
    std::size_t line() const { return line_; }

  private:
    std::istream& in_;
    std::string text_;
    LineProblem problem_;
    std::size_t line_ = 0;
    std::int64_t last_ns_ = INT64_MIN;
};

// The whole log at once; at most 20 problems are kept, `bad_lines` counts all.
struct CandumpLog {
    std::vector<LogFrame> frames;
    std::vector<LineProblem> problems;
    std::size_t bad_lines = 0;
};
CandumpLog read_candump(std::istream& in);

}  // namespace wheelwright::tools
