// The robot file (robot.toml): the one place where it is read, checked and written back. Its keys, units,
// defaults and ranges are those of model::parameter_table(), the effects' catalogue and simulation_table().
//
// Everything here allocates and waits for files: start-up, tools and the saving thread only. No call throws
// anything but std::bad_alloc.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "firmware/task/simulation_parameters.hpp"

namespace wheelwright::task {

// One thing wrong with, or worth knowing about, a robot file. Line and column count from 1, characters not
// bytes; 0 when the whole file is meant.
struct Diagnostic {
    std::string file;
    std::uint32_t line = 0;
    std::uint32_t column = 0;
    std::string key;      // dotted path; empty when there is none
    std::string message;  // what was found, what was expected, and a hint where there is a likely one
};

// "file:line:column: key: message", without the parts that are missing.
std::string to_text(const Diagnostic& diagnostic);

// From which log and day numbers come; kept as text.
struct Provenance {
    std::string log;
    std::string date;
};

struct RobotFile {
    std::string name;                   // robot.name; empty when not given
    std::string lines_chip;             // lines.chip, path of the gpiochip device; empty when not given
    std::string key_file;               // arming.key_file, as in the file; empty when not given
    model::RobotParameters parameters;  // defaults where the file says nothing
    Provenance dynamics_provenance;
    std::array<Provenance, model::kEffectCount> effect_provenance;
    std::optional<model::MassProperties<double>> mass;  // given instead of K5..K8, which then follow from it
    SimulationParameters simulation;                    // defaults where the file says nothing
    std::vector<std::string> given;                     // dotted keys the file has, in its order

    bool is_given(std::string_view key) const;
};

// `robot` is set exactly when `problems` is empty. `problems` lists everything wrong, in the file's order
// (after a syntax error nothing else can be known). `notes` are legal but worth a look.
struct RobotFileResult {
    std::optional<RobotFile> robot;
    std::vector<Diagnostic> problems;
    std::vector<Diagnostic> notes;
};

RobotFileResult parse_robot_file(std::string_view text, const std::string& file_name);
RobotFileResult read_robot_file(const std::string& path);

// A value for a key of the robot file. A double is written as the shortest text that reads back as the same
// number.
using FileValue = std::variant<double, std::int64_t, bool, std::string>;
struct FileChange {
    std::string key;  // dotted path
    FileValue value;
};

// The change that gives the parameter of a CAN index (effects included) the value `value`; nothing for an
// unknown index. A number that is exactly a float (it came over the bus) is written with a float's digits:
// 0.3, not 0.30000001192092896.
std::optional<FileChange> file_change(std::uint16_t index, double value);

// `text` with these values in place: order, spelling and every other byte stay. So do comments, but one
// behind a value that changes is turned into a note of the former value, as it was written about that: "# was
// 0.32: taped"
// ("# was 0.32: ..." stays as it is at the next change). A key that is
// missing is added at the end of its table, a table that is missing at the end of the file. The result has
// been parsed again and differs from `text` in these values only; otherwise `text` is unset and `error` says
// why. Later changes of the same key win.
struct EditResult {
    std::optional<std::string> text;
    std::string error;
};
EditResult set_values(std::string_view text, std::span<const FileChange> changes);

// Reads the file again (somebody may have edited it), sets the values, checks that the result is a good robot
// file and writes it whole. Returns "" when done, else one sentence; the file is then as it was.
std::string save_robot_file(const std::string& path, std::span<const FileChange> changes);

// Keys besides the tables', for reference pages.
struct MassInfo {
    std::string_view key;
    std::string_view unit;
    double minimum, maximum;
    double model::MassProperties<double>::*field;
    std::string_view meaning;
};
std::span<const MassInfo> mass_table();

struct TextInfo {
    std::string_view key;
    std::string_view meaning;
};
std::span<const TextInfo> text_table();

// The shortest text that reads back as `value`, always recognisable as a real number ("5.0").
std::string shortest_number(double value);

}  // namespace wheelwright::task
