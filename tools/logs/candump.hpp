// Reader of whole candump -L logs. Lines that begin with '#' are comments, as can-utils have it.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include "hal/linux/candump.hpp"

namespace wheelwright::tools {

using hal::format_candump_line;
using hal::LogFrame;
using hal::parse_candump_line;

// Something wrong with a line of a log.
struct LineProblem {
    std::size_t line = 0;  // from 1; 0: the whole file
    std::string message;
};

std::string to_text(const std::string& file, const LineProblem& problem);

// Whether a file begins as a candump -L log does, with '(' behind comments; nothing if it cannot be opened
// (errno says why).
std::optional<bool> is_candump(const std::string& path);

// Reads a log line by line. Lines must not go back in time; equal times are fine. Blank lines and comments
// are skipped.
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
