// Any text as a robot file: parsed or refused with a place, and what is parsed can be changed and read again.
#include <fuzzer/FuzzedDataProvider.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "firmware/task/robot_file.hpp"
#include "tests/fuzz/expect.hpp"

using namespace wheelwright;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    FuzzedDataProvider input(data, size);
    // taken from the end, so that a corpus of plain robot files stays one
    const auto which = input.ConsumeIntegral<std::uint16_t>();
    const double share = input.ConsumeProbability<double>();
    const std::string text = input.ConsumeRemainingBytesAsString();

    const task::RobotFileResult result = task::parse_robot_file(text, "robot.toml");
    FUZZ_EXPECT(result.robot.has_value() == result.problems.empty());
    const auto lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n')) + 1;
    for (const auto* list : {&result.problems, &result.notes}) {
        for (const task::Diagnostic& d : *list) {
            FUZZ_EXPECT(!d.message.empty() && !task::to_text(d).empty());
            FUZZ_EXPECT(d.line <= lines);
        }
    }
    if (!result.robot) return 0;

    const auto table = model::parameter_table();
    const model::ParameterInfo& parameter = table[which % table.size()];
    const double value = parameter.minimum + share * (parameter.maximum - parameter.minimum);
    const std::array changes{*task::file_change(parameter.index, std::round(value))};
    const task::EditResult edited = task::set_values(text, changes);
    FUZZ_EXPECT(edited.text.has_value() == edited.error.empty());
    if (!edited.text) return 0;
    // the same change again leaves every byte
    const task::EditResult again = task::set_values(*edited.text, changes);
    FUZZ_EXPECT(again.text == edited.text);
    return 0;
}
