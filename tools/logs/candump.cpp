#include "tools/logs/candump.hpp"

#include <fstream>
#include <istream>

namespace wheelwright::tools {
namespace {

constexpr std::size_t kKeptProblems = 20;

bool says_nothing(const std::string& line) {
    const std::size_t first = line.find_first_not_of(" \t\r");
    return first == std::string::npos || line[first] == '#';
}

}  // namespace

std::string to_text(const std::string& file, const LineProblem& problem) {
    std::string text = file + ":";
    if (problem.line > 0) text += std::to_string(problem.line) + ":";
    return text + " " + problem.message;
}

std::optional<bool> is_candump(const std::string& path) {
    std::ifstream in(path);
    if (!in) return std::nullopt;
    std::string line;
    while (std::getline(in, line) && says_nothing(line)) {
    }
    const std::size_t first = line.find_first_not_of(" \t\r");
    return first != std::string::npos && line[first] == '(';
}

CandumpReader::Next CandumpReader::next(LogFrame& out) {
    while (std::getline(in_, text_)) {
        ++line_;
        if (says_nothing(text_)) continue;
        std::string failed = parse_candump_line(text_, out);
        if (failed.empty() && out.time_ns < last_ns_) {
            failed = "time goes back by " + std::to_string((last_ns_ - out.time_ns) / 1000) + " microseconds";
        }
        if (!failed.empty()) {
            problem_ = {line_, failed};
            return Next::bad_line;
        }
        last_ns_ = out.time_ns;
        return Next::frame;
    }
    return Next::end;
}

CandumpLog read_candump(std::istream& in) {
    CandumpLog log;
    CandumpReader reader(in);
    LogFrame entry;
    for (;;) {
        switch (reader.next(entry)) {
            case CandumpReader::Next::frame:
                log.frames.push_back(entry);
                break;
            case CandumpReader::Next::bad_line:
                ++log.bad_lines;
                if (log.problems.size() < kKeptProblems) log.problems.push_back(reader.problem());
                break;
            case CandumpReader::Next::end:
                return log;
        }
    }
}

}  // namespace wheelwright::tools
