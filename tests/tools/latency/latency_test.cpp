#include "tools/latency/measure.hpp"

#include <CppUTest/TestHarness.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tools/cli/scratch_folder.hpp"
#include "tools/latency/machine.hpp"

using namespace wheelwright;
using namespace wheelwright::tools;

namespace {

void write(const std::filesystem::path& path, const std::string& text) {
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << text << "\n";
}

bool advises(const std::vector<Advice>& list, const std::string& words) {
    return std::any_of(list.begin(), list.end(), [&](const Advice& a) {
        return (a.what + " " + a.change).find(words) != std::string::npos;
    });
}

Latency punctual() {
    Latency latency;
    for (int i = 0; i < 10'000; ++i) latency.sending.add(5'000);
    latency.cycles = 10'000;
    return latency;
}

}  // namespace

TEST_GROUP(Latency){};

// As cyclictest 2.4 prints it.
TEST(Latency, cyclictest_is_read_with_what_lies_beyond_its_bins) {
    const auto h = read_cyclictest(
        "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000003 000090\n000004 000007\n"
        "# Total: 000000097\n# Min Latencies: 00003\n# Avg Latencies: 00003\n# Max Latencies: 16645\n"
        "# Histogram Overflows: 00003\n# Histogram Overflow at cycle number:\n# Thread 0: 00000 00001 "
        "00002\n");
    CHECK(h.has_value());
    CHECK_EQUAL(100U, h->total());
    CHECK_EQUAL(90U, h->count(3));
    CHECK_EQUAL(16'645'000, h->largest_ns());
    CHECK_EQUAL(5'000, h->quantile_ns(0.95));
    CHECK_FALSE(read_cyclictest("unable to get scheduling\n").has_value());
    CHECK_FALSE(read_cyclictest("").has_value());
}

TEST(Latency, a_machine_is_fit_when_nothing_is_missed_and_torques_are_punctual) {
    Latency latency = punctual();
    CHECK(fitness(latency) == Fitness::fit);
    for (int i = 0; i < 9; ++i) latency.sending.add(400'000);
    CHECK(fitness(latency) == Fitness::fit);
    for (int i = 0; i < 3; ++i) latency.sending.add(400'000);
    CHECK(fitness(latency) == Fitness::limited);
    latency.missed = 1;
    CHECK(fitness(latency) == Fitness::unfit);
}

TEST(Latency, a_machine_is_looked_at_and_advised) {
    const ScratchFolder folder;
    const std::filesystem::path root = folder.path();
    write(root / "proc/sys/kernel/osrelease", "6.1.0-rt");
    write(root / "proc/cpuinfo", "flags : fpu vme");
    write(root / "proc/31/comm", "irq/47-can0");
    write(root / "proc/31/stat",
          "31 (irq/47-can0) S 2 0 0 0 -1 2129984 0 0 0 0 0 0 0 0 -51 0 1 0 9 0 0 "
          "18446744073709551615 0 0 0 0 0 0 0 2147483647 0 0 0 0 17 0 50 1 0 0 0");
    write(root / "sys/kernel/realtime", "1");
    write(root / "sys/devices/system/cpu/isolated", "");
    write(root / "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance");
    write(root / "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "schedutil");
    write(root / "sys/devices/system/cpu/cpu1/cpuidle/state2/latency", "133");
    write(root / "sys/devices/system/cpu/cpu1/cpuidle/state2/disable", "0");
    write(root / "sys/devices/system/cpu/cpu1/cpuidle/state3/latency", "900");
    write(root / "sys/devices/system/cpu/cpu1/cpuidle/state3/disable", "1");
    write(root / "sys/class/net/eth0/type", "1");
    write(root / "sys/class/net/can0/type", "280");
    write(root / "sys/class/net/can0/tx_queue_len", "10");
    write(root / "sys/class/net/can0/device/vendor", "0x1");
    write(root / "sys/class/net/vcan0/type", "280");
    write(root / "sys/class/net/vcan0/tx_queue_len", "0");

    const Machine m = look_at_machine(
        root, R"([{"ifname":"can0","qdisc":"fq_codel"},{"ifname":"vcan0","qdisc":"noqueue"}])");
    STRCMP_EQUAL("6.1.0-rt", m.kernel.c_str());
    CHECK(m.realtime_kernel);
    CHECK_FALSE(m.virtual_machine);
    CHECK_EQUAL(2, m.processors);
    STRCMP_EQUAL("schedutil", m.governor.c_str());
    DOUBLES_EQUAL(133, m.idle_exit_us, 1e-9);
    CHECK_EQUAL(2U, m.can.size());
    CHECK_EQUAL(50, m.can[0].irq_priority.value_or(-1));
    CHECK_FALSE(m.can[1].irq_priority.has_value());

    const std::vector<Advice> list = advice(m, 80, std::nullopt);
    for (const char* words : {"schedutil", "133 us", "can0 queues its frames by fq_codel",
                              "can0 holds 10 frames", "chrt --fifo --pid 79", "isolcpus=1"}) {
        CHECK_TEXT(advises(list, words), words);
    }
    CHECK_FALSE(advises(list, "PREEMPT_RT"));
    CHECK_FALSE(advises(list, "vcan0"));

    Machine good = m;
    good.governor.clear();
    good.idle_exit_us = 1;
    good.isolated = "1";
    good.can.clear();
    CHECK_EQUAL(0U, advice(good, 80, 1).size());
    CHECK(advises(advice(good, 80, std::nullopt), "realtime.cpu"));
    good.realtime_kernel = false;
    CHECK(advises(advice(good, 80, 1), "linux-image-rt"));
}

// Whatever machine this is, and whatever else it does: the figures hold together.
TEST(Latency, the_whole_firmware_is_measured) {
    LatencyOptions options;
    options.duration_s = 1;
    Latency latency;
    std::thread([&] { latency = measure_latency(options); }).join();  // it ends with its priority
    CHECK_EQUAL(1000U, latency.cycles);
    CHECK_EQUAL(1000U, latency.wake_up.total());
    CHECK_EQUAL(1000U, latency.cycle.total());
    CHECK_EQUAL(1000U, latency.sending.total());
    CHECK(latency.cycle.quantile_ns(0.5) > 0);
    CHECK_FALSE(latency.cyclictest.has_value());
    CHECK(latency.no_cyclictest.find("rt-tests") != std::string::npos);
}
