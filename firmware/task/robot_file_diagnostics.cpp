#include "firmware/task/robot_file_diagnostics.hpp"

#include <algorithm>
#include <tuple>
#include <utility>

namespace wheelwright::task {
namespace {

// Those of one place stay in the order in which they were found.
std::vector<Diagnostic> by_place(std::vector<Diagnostic> diagnostics) {
    std::stable_sort(diagnostics.begin(), diagnostics.end(), [](const Diagnostic& a, const Diagnostic& b) {
        return std::tie(a.line, a.column) < std::tie(b.line, b.column);
    });
    return diagnostics;
}

}  // namespace

std::string to_text(const Diagnostic& diagnostic) {
    std::string text = diagnostic.file;
    if (diagnostic.line > 0) {
        text.append(":").append(std::to_string(diagnostic.line));
        text.append(":").append(std::to_string(diagnostic.column));
    }
    if (!diagnostic.key.empty()) text += ": " + diagnostic.key;
    return text + ": " + diagnostic.message;
}

Diagnostics::Diagnostics(std::string file_name) : file_(std::move(file_name)) {}

void Diagnostics::remember(const std::string& key, Position at) { given_.emplace(key, at); }

bool Diagnostics::is_given(std::string_view key) const { return given_.find(key) != given_.end(); }

Position Diagnostics::position(std::string_view key) const {
    const auto found = given_.find(key);
    return found == given_.end() ? Position{} : found->second;
}

void Diagnostics::problem_at(Position at, std::string key, std::string message) {
    problems_.push_back({file_, at.line, at.column, std::move(key), std::move(message)});
}

void Diagnostics::problem(std::string key, std::string message) {
    const Position at = position(key);
    problem_at(at, std::move(key), std::move(message));
}

void Diagnostics::note(std::string key, std::string message) {
    const Position at = position(key);
    notes_.push_back({file_, at.line, at.column, std::move(key), std::move(message)});
}

bool Diagnostics::has_problems() const { return !problems_.empty(); }

RobotFileResult Diagnostics::result(RobotFile robot) const {
    RobotFileResult result;
    result.problems = by_place(problems_);
    if (has_problems()) return result;
    std::vector<std::pair<Position, std::string>> order;
    for (const auto& [key, at] : given_) order.emplace_back(at, key);
    std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
        return std::tie(a.first.line, a.first.column) < std::tie(b.first.line, b.first.column);
    });
    for (auto& [at, key] : order) robot.given.push_back(std::move(key));
    result.robot = std::move(robot);
    result.notes = by_place(notes_);
    return result;
}

}  // namespace wheelwright::task
