#include "tools/latency/machine.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/cli/report.hpp"

namespace wheelwright::tools {
namespace {

namespace fs = std::filesystem;

constexpr int kCanType = 280;        // ARPHRD_CAN, in /sys/class/net/*/type
constexpr double kSlowExit_us = 50;  // a twentieth of a cycle
// Both drives' torques and stops, and the telemetry of some cycles behind them: what a host's burst may hold
// up.
constexpr std::int64_t kLeastQueue = 32;

std::string read(const fs::path& path) {
    std::ifstream file(path);
    std::string text{std::istreambuf_iterator<char>(file), {}};
    while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
    return text;
}

long number(const std::string& text, long otherwise = 0) {
    std::istringstream in(text);
    long value = otherwise;
    return in >> value ? value : otherwise;
}

std::vector<fs::path> entries(const fs::path& folder) {
    std::vector<fs::path> found;
    std::error_code error;
    for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
        found.push_back(at->path());
    }
    std::sort(found.begin(), found.end());
    return found;
}

bool starts_with_number(const std::string& name, const std::string& prefix) {
    return name.rfind(prefix, 0) == 0 && name.size() > prefix.size() &&
           std::all_of(name.begin() + std::ptrdiff_t(prefix.size()), name.end(),
                       [](char c) { return c >= '0' && c <= '9'; });
}

// The kernel names the thread of interrupt 47 of can0 "irq/47-can0".
std::optional<int> irq_priority(const fs::path& proc, const std::string& interface) {
    for (const fs::path& process : entries(proc)) {
        const std::string name = read(process / "comm");
        if (name.rfind("irq/", 0) != 0 || name.substr(name.find('-') + 1) != interface) continue;
        // "PID (name) S ...": the priority is the 40th word, the 38th behind the name.
        const std::string stat = read(process / "stat");
        std::istringstream in(stat.substr(stat.rfind(')') + 1));
        const std::vector<std::string> words{std::istream_iterator<std::string>(in), {}};
        if (words.size() > 37) return static_cast<int>(number(words[37]));
    }
    return std::nullopt;
}

}  // namespace

Machine look_at_machine(const std::string& root, const std::string& ip_json) {
    const fs::path proc = root + "/proc";
    const fs::path sys = root + "/sys";
    Machine m;
    m.kernel = read(proc / "sys/kernel/osrelease");
    m.realtime_kernel = read(sys / "kernel/realtime") == "1";
    const std::string cpuinfo = read(proc / "cpuinfo");
    m.virtual_machine = cpuinfo.find(" hypervisor") != std::string::npos ||
                        read(proc / "device-tree/hypervisor/compatible").size() > 0;
    m.isolated = read(sys / "devices/system/cpu/isolated");
    for (const fs::path& cpu : entries(sys / "devices/system/cpu")) {
        if (!starts_with_number(cpu.filename(), "cpu")) continue;
        ++m.processors;
        const std::string governor = read(cpu / "cpufreq/scaling_governor");
        if (!governor.empty() && governor != "performance" && m.governor.empty()) m.governor = governor;
        for (const fs::path& state : entries(cpu / "cpuidle")) {
            if (read(state / "disable") == "1") continue;
            m.idle_exit_us = std::max(m.idle_exit_us, double(number(read(state / "latency"))));
        }
    }
    const auto links = nlohmann::json::parse(ip_json, nullptr, false);
    for (const fs::path& net : entries(sys / "class/net")) {
        if (number(read(net / "type")) != kCanType) continue;
        CanInterface can;
        can.name = net.filename();
        can.queue_frames = number(read(net / "tx_queue_len"));
        can.has_controller = fs::exists(net / "device");
        can.irq_priority = irq_priority(proc, can.name);
        for (const auto& link : links.is_array() ? links : nlohmann::json::array()) {
            if (link.value("ifname", "") == can.name) can.queueing = link.value("qdisc", "");
        }
        m.can.push_back(std::move(can));
    }
    return m;
}

std::vector<Advice> advice(const Machine& m, int priority, std::optional<int> cpu) {
    std::vector<Advice> list;
    if (!m.realtime_kernel) {
        list.push_back({"the kernel " + m.kernel + " is not PREEMPT_RT",
                        "install one: linux-image-rt-amd64 or linux-image-rt-arm64 in Debian"});
    }
    if (m.virtual_machine) {
        list.push_back({"this is a virtual machine",
                        "another machine's work delays it, and nothing here can prevent that"});
    }
    if (!m.governor.empty()) {
        list.push_back({"the processors' frequency follows the governor " + m.governor,
                        "cpupower frequency-set --governor performance"});
    }
    if (m.idle_exit_us > kSlowExit_us) {
        list.push_back(
            {"waking from the deepest idle state takes " + number_text(m.idle_exit_us) + " us",
             "wheelwrightd forbids it while it runs, if it may open /dev/cpu_dma_latency for writing"});
    }
    for (const CanInterface& can : m.can) {
        if (!can.queueing.empty() && can.queueing != "pfifo_fast" && can.queueing != "noqueue") {
            list.push_back(
                {can.name + " queues its frames by " + can.queueing + ", which may drop or reorder them",
                 "tc qdisc replace dev " + can.name + " root pfifo_fast"});
        }
        if (can.has_controller && can.queue_frames < kLeastQueue) {
            list.push_back({can.name + " holds " + std::to_string(can.queue_frames) + " frames",
                            "ip link set " + can.name + " txqueuelen 128"});
        }
        if (can.irq_priority && *can.irq_priority <= 50) {
            list.push_back({"the interrupt thread of " + can.name + " has priority " +
                                std::to_string(*can.irq_priority) + ", as those of disks and network have",
                            "chrt --fifo --pid " + std::to_string(priority - 1) + " $(pgrep 'irq/.*-" +
                                can.name + "')"});
        }
    }
    if (m.processors > 1 && (m.isolated.empty() || !cpu)) {
        const std::string last = std::to_string(m.processors - 1);
        list.push_back(
            {m.isolated.empty() ? "no processor is kept for the firmware alone"
                                : "processor " + m.isolated + " is kept free, and not given to the firmware",
             m.isolated.empty() ? "isolcpus=" + last + " nohz_full=" + last + " rcu_nocbs=" + last +
                                      " on the kernel's command line, and realtime.cpu = " + last
                                : "realtime.cpu in the robot file"});
    }
    return list;
}

}  // namespace wheelwright::tools
