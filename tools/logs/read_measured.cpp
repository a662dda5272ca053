#include "tools/logs/read_measured.hpp"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "tools/logs/measured_csv.hpp"
#include "tools/logs/sysid_json.hpp"

namespace wheelwright::tools {

LogPath log_path(const std::string& path) {
    const std::size_t colon = path.rfind(".json:");
    if (colon == std::string::npos || std::filesystem::exists(path)) return {path, ""};
    return {path.substr(0, colon + 5), path.substr(colon + 6)};
}

std::optional<LogForm> log_form(const std::string& path) {
    std::ifstream in(log_path(path).file);
    if (!in) return std::nullopt;
    char first = 0;
    in >> first;  // skips blanks
    return first == '(' ? LogForm::candump : first == '{' ? LogForm::sysid_json : LogForm::csv;
}

MeasuredLogs read_measured_log(const std::string& path, const LogReading& reading) {
    const std::optional<LogForm> form = log_form(path);
    const LogPath where = log_path(path);
    std::ifstream in(where.file);
    if (!form || !in) {
        MeasuredLogs logs;
        logs.problem(0, std::string("cannot open: ") + std::strerror(errno));
        return logs;
    }
    if (*form == LogForm::csv) return read_measured_csv(in, reading);
    return read_sysid_json(std::string(std::istreambuf_iterator<char>(in), {}), reading, where.run);
}

}  // namespace wheelwright::tools
