// Any bytes as the file of a black box: refused with a reason, or each cycle has the lines that it announces,
// and the memory is what its hash says.
#include <sstream>
#include <string>

#include "firmware/task/black_box_file.hpp"
#include "tests/fuzz/expect.hpp"

using namespace wheelwright;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
    task::BlackBoxFile file;
    if (!task::read_black_box(in, file).empty()) return 0;
    FUZZ_EXPECT(!file.memory.empty() && !file.cycles.empty());
    FUZZ_EXPECT(file.memory_cycle + 1 >= file.first_cycle);
    FUZZ_EXPECT(file.memory_cycle + 1 < file.first_cycle + file.cycles.size());
    for (const task::BoxCycle& cycle : file.cycles) {
        for (const task::BoxFrame& frame : cycle.frames) {
            FUZZ_EXPECT(frame.bus <= 1 && frame.received.frame.length <= 64);
            FUZZ_EXPECT(frame.kind != task::RecordKind::cycle && frame.kind != task::RecordKind::statistics);
        }
    }
    return 0;
}
