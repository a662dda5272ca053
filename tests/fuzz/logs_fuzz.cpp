// Any bytes as a log: candump, CSV of other loggers, SysId's JSON. What is good is finite and in order of
// time; what is not is refused with a message.
#include <cmath>
#include <sstream>
#include <string>
#include <string_view>

#include "tests/fuzz/expect.hpp"
#include "tools/logs/candump.hpp"
#include "tools/logs/measured_csv.hpp"
#include "tools/logs/sysid_json.hpp"

using namespace wheelwright;

namespace {

void read_candump(const std::string& text) {
    std::istringstream in(text);
    const tools::CandumpLog log = tools::read_candump(in);
    FUZZ_EXPECT(log.problems.size() <= 20 && log.problems.size() <= log.bad_lines);
    std::int64_t before_ns = INT64_MIN;
    for (const tools::LogFrame& frame : log.frames) {
        FUZZ_EXPECT(frame.time_ns >= before_ns);
        before_ns = frame.time_ns;
        const std::string line = tools::format_candump_line(frame);
        tools::LogFrame again;
        FUZZ_EXPECT(tools::parse_candump_line(line, again).empty());
        FUZZ_EXPECT(tools::format_candump_line(again) == line);
    }
}

void judge(const tools::MeasuredLogs& logs) {
    FUZZ_EXPECT(logs.segments.empty() == (logs.problem_count > 0));
    FUZZ_EXPECT(logs.problems.size() <= 20 && logs.problems.size() <= logs.problem_count);
    for (const tools::MeasuredLog& log : logs.segments) {
        FUZZ_EXPECT(std::isfinite(log.period_s) && log.period_s > 0);
        double before_s = -INFINITY;
        for (const tools::MeasuredSample& s : log.samples) {
            FUZZ_EXPECT(s.t_s > before_s);
            before_s = s.t_s;
            for (const double value : {s.t_s, s.torque_Nm.left, s.torque_Nm.right, s.speed_rad_per_s.left,
                                       s.speed_rad_per_s.right, s.gyro_rad_per_s, s.accel_m_per_s2})
                FUZZ_EXPECT(std::isfinite(value));
        }
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string text(reinterpret_cast<const char*>(data), size);
    tools::LogReading reading;
    reading.torque_per_volt_Nm = 0.5;
    reading.wheel_radius_m = {0.08, 0.08};
    // each reader by what its files begin with, as the tools choose
    if (text.starts_with('(')) {
        read_candump(text);
    } else if (text.starts_with('{')) {
        judge(tools::read_sysid_json(text, reading));
    } else {
        std::istringstream in(text);
        judge(tools::read_measured_csv(in));
    }
    return 0;
}
