// What the reading of one robot file brings to light: where its values stand, what is wrong and what is worth
// a note. Used by robot_file*.cpp.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::task {

// As in Diagnostic: counted from 1, 0 when the whole file is meant.
struct Position {
    std::uint32_t line = 0;
    std::uint32_t column = 0;
};

class Diagnostics {
  public:
    explicit Diagnostics(std::string file_name);

    // A known key has a value, good or bad, that stands at `at`.
    void remember(const std::string& key, Position at);
    bool is_given(std::string_view key) const;
    Position position(std::string_view key) const;  // of its value; the whole file when not given

    void problem_at(Position at, std::string key, std::string message);
    void problem(std::string key, std::string message);  // at the key's value
    void note(std::string key, std::string message);     // at the key's value
    bool has_problems() const;

    // Everything in the file's order; with `robot` and the notes only when there are no problems.
    RobotFileResult result(RobotFile robot) const;

  private:
    std::string file_;
    std::map<std::string, Position, std::less<>> given_;
    std::vector<Diagnostic> problems_;
    std::vector<Diagnostic> notes_;
};

}  // namespace wheelwright::task
