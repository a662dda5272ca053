// The black box from the cycle to the file and back: what was recorded runs again to the same bytes, and what
// was changed is named.
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "firmware/task/black_box_writer.hpp"
#include "firmware/task/build_identity.hpp"
#include "tests/chain/scene.hpp"
#include "tools/cli/scratch_folder.hpp"
#include "tools/logs/candump.hpp"
#include "tools/replay/cycle_replay.hpp"
#include "tools/sim/cycle_rig.hpp"
//
#include <CppUTest/TestHarness.h>
#include <malloc.h>

using namespace wheelwright;
using namespace wheelwright::tools;
using protocol::Fault;
using protocol::Mode;

namespace {

std::string text_of(const std::filesystem::path& path) {
    std::ifstream in(path);
    return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::filesystem::path> files_in(const std::string& folder) {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    return files;
}

struct Replayed {
    std::string problem;
    task::BlackBoxFile file;
    ReplayResult result;
    bool same() const { return problem.empty() && result.problem.empty() && !result.difference; }
    std::string why() const {
        return problem + result.problem + (result.difference ? result.difference->what : std::string());
    }
};

Replayed replayed(const std::string& text) {
    Replayed r;
    std::istringstream in(text);
    r.problem = task::read_black_box(in, r.file);
    if (r.problem.empty()) r.result = replay(r.file);
    return r;
}

// The box of a robot that drives for `drive_s`, and is stopped.
std::string stopped_drive(
    bool host_bus, double drive_s, const std::function<void(Simulation&)>& each = [](Simulation&) {}) {
    const ScratchFolder folder;
    SimulationOptions options = chain::Scene::options({host_bus, 0, 1}, 7);
    options.black_box = folder.path();
    options.robot_file = "[robot]\nname = \"" + std::string(400, 'x') + "\"\n";
    Simulation sim(chain::identified(), chain::real().parameters, options);
    sim.run_for(0.5);
    sim.host().velocity({0.4, 0.3});
    CHECK(enter_mode(sim, Mode::velocity));
    sim.run_for(drive_s, [&] { each(sim); });
    sim.host().emergency_stop();
    sim.run_for(0.5);
    CHECK(sim.cycle().supervisor().fault() != Fault::none);
    CHECK(files_in(folder.path()).empty());  // what follows belongs to it
    sim.end_recording();
    const auto files = files_in(folder.path());
    CHECK_EQUAL(1U, files.size());
    STRCMP_CONTAINS("black-box-000001-", files[0].filename().c_str());
    return text_of(files[0]);
}

// Made before main(), for CppUTest counts what is allocated in a test and kept.
const std::string kDrive = stopped_drive(false, 1);
const std::string& drive() { return kDrive; }

// The text with the first line that holds `needle` changed.
std::string changed(std::string text, const std::string& needle,
                    const std::function<void(std::string&)>& change) {
    const std::size_t at = text.find(needle);
    CHECK(at != std::string::npos);
    const std::size_t begin = text.rfind('\n', at) + 1;
    const std::size_t end = text.find('\n', at) + 1;
    std::string line = text.substr(begin, end - begin);
    change(line);
    return text.replace(begin, end - begin, line);
}

}  // namespace

TEST_GROUP(BlackBox){};

TEST(BlackBox, a_drive_that_was_stopped_runs_again_to_the_same_bytes) {
    for (const bool host_bus : {false, true}) {
        const Replayed r = replayed(stopped_drive(host_bus, 1));
        CHECK_TEXT(r.same(), r.why().c_str());
        CHECK(r.file.as_written);
        CHECK(r.result.cycles > 1900);
        CHECK(r.result.received > 2 * 1900);
        CHECK(r.result.sent > 2 * 1000);
        STRCMP_EQUAL("emergency_stop_message", r.file.fault.c_str());
        CHECK(r.file.cycles[r.file.fault_cycle - r.file.first_cycle].told.state.fault ==
              Fault::emergency_stop_message);
        STRCMP_EQUAL(host_bus ? "can1" : "", r.file.about.interface[1].c_str());
    }
}

TEST(BlackBox, it_begins_in_the_middle_of_a_long_drive) {
    const Replayed r = replayed(stopped_drive(false, 42));
    CHECK_TEXT(r.same(), r.why().c_str());
    CHECK(r.file.memory_cycle > 10'000);
    CHECK(double(r.result.cycles) * task::kCyclePeriod_s > task::kBlackBoxWindow_s);
    CHECK(double(r.result.cycles) * task::kCyclePeriod_s < task::kBlackBoxWindow_s + 12);
}

TEST(BlackBox, everything_else_that_a_cycle_is_told_is_in_it) {
    int cycle = 0;
    const Replayed r = replayed(stopped_drive(true, 2, [&](Simulation& sim) {
        ++cycle;
        using protocol::ParameterOperation;
        const model::ParameterInfo& info = *model::find_parameter("velocity_loop.damping");
        if (cycle == 100) sim.host().parameter(ParameterOperation::write, info.index, 0.8F);
        if (cycle == 110) sim.host().parameter(ParameterOperation::commit, 0);
        if (cycle == 120 || cycle == 130)
            sim.host().parameter(ParameterOperation::save, 0);  // the second: not now
        if (cycle == 140) sim.mailbox().finished(false);
        if (cycle == 150) sim.host().parameter(ParameterOperation::save, 0);
        if (cycle == 160) sim.mailbox().finished(true);
        if (cycle == 200) sim.stall(0.0022);
        if (cycle == 1700) sim.stall(0.0045);
        if (cycle == 500) sim.bus().inject_error_frame(4);
        if (cycle == 1800) sim.bus().set_down(0, true);
        if (cycle == 1802) sim.bus().set_down(0, false);
        if (cycle == 1850) sim.drive_enable().set_broken(true);
        if (cycle == 1851) sim.drive_enable().set_broken(false);
        if (cycle == 1900) sim.emergency_stop().set(hal::LineLevel::active);
        if (cycle == 1990) sim.cycle().request_termination();
    }));
    CHECK_TEXT(r.same(), r.why().c_str());
}

TEST(BlackBox, tools_that_read_candump_read_it) {
    std::istringstream in(drive());
    const CandumpLog log = read_candump(in);
    CHECK_EQUAL(0U, log.bad_lines);
    const Replayed r = replayed(drive());
    CHECK_EQUAL(r.result.received + r.result.sent, log.frames.size());
    std::istringstream lines(drive());
    for (std::string line; std::getline(lines, line);)
        CHECK(line.size() < 200);  // can-utils have small buffers
}

TEST(BlackBox, a_frame_that_was_changed_is_named) {
    const std::string needle = " T 1000.";  // sent in cycle 1000
    const Replayed r = replayed(changed(drive(), needle, [](std::string& line) {
        char& digit = line[line.find('#') + 1];
        digit = digit == '0' ? '1' : '0';
    }));
    CHECK(r.result.difference && !r.file.as_written);
    CHECK_EQUAL(1000U, r.result.difference->cycle);
    STRCMP_CONTAINS("frame 1: recorded can0", r.result.difference->what.c_str());
}

TEST(BlackBox, a_received_frame_that_was_changed_changes_what_follows) {
    // The left encoder's position, one step of a float more, once.
    std::string text = drive();
    std::size_t at = text.find(" R 900.");
    while (text.compare(text.rfind('#', at) - 3, 3, "029") != 0) at = text.find(" R ", at + 1);
    char& digit = text[text.rfind('#', at) + 5];
    digit = digit == '0' ? '1' : '0';
    const Replayed other = replayed(text);
    CHECK(other.result.difference.has_value() && !other.file.as_written);
    CHECK(other.result.difference->cycle >= 900 && other.result.difference->cycle < 950);
}

TEST(BlackBox, what_cannot_be_replayed_says_why) {
    const auto why = [](const std::string& text) { return replayed(text).why(); };
    STRCMP_CONTAINS("no black box", why("(1.0) can0 123#\n").c_str());
    const std::string whole = drive();
    STRCMP_CONTAINS("ends in the middle",
                    why(whole.substr(0, whole.find('\n', whole.size() / 2) + 1)).c_str());
    STRCMP_CONTAINS("only the same build", why(changed(drive(), "#: build", [](std::string& line) {
                                               line.insert(line.size() - 1, "x");
                                           })).c_str());
    STRCMP_CONTAINS("memory has been changed", why(changed(drive(), "#=", [](std::string& line) {
                                                   line[10] = line[10] == '0' ? '1' : '0';
                                               })).c_str());
    STRCMP_CONTAINS("is missing",
                    why(changed(drive(), " R 900.", [](std::string& line) { line.clear(); })).c_str());
    STRCMP_CONTAINS("cycle 900 is missing",
                    why(changed(drive(), "#> 900 ", [](std::string& line) { line.clear(); })).c_str());
}

TEST(BlackBox, the_robot_file_and_the_parameters_can_be_read_in_it) {
    CHECK(drive().find("\n#|[robot]\n") != std::string::npos);
    CHECK(drive().find("\n#*velocity_loop.damping = ") != std::string::npos);
    const Replayed r = replayed(drive());
    STRCMP_CONTAINS(std::string(400, 'x').c_str(), r.file.about.robot_file.c_str());
}

TEST(BlackBox, the_memory_has_no_address_in_it) {
    ::mallopt(M_PERTURB, 0x5B);  // what no one writes is filled, and is not what somebody else has left there
    tools::ExampleRobots robots = tools::example_robots(true);
    tools::RigOptions options;
    options.world = robots.world;
    const auto rig = std::make_unique<tools::CycleRig>(robots.controller, robots.truth, options);
    ::mallopt(M_PERTURB, 0);
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::figure_eight;
    for (int i = 0; i < 3000; ++i) {
        if (i == 300) rig->host().trajectory(command);
        if (i == 300) rig->host().mode(Mode::adaptive);
        rig->step();
    }
    CHECK(rig->cycle().supervisor().mode() == Mode::adaptive);
    struct Range {
        std::uint64_t begin, end;
    };
    std::vector<Range> mapped;
    std::ifstream maps("/proc/self/maps");
    for (std::string line; std::getline(maps, line);) {
        Range range{};
        CHECK_EQUAL(2, std::sscanf(line.c_str(), "%lx-%lx", &range.begin, &range.end));
        mapped.push_back(range);
    }
    std::size_t words = 0;
    for (const auto& part : rig->cycle().memory()) {
        // Pointers and what they point to lie at multiples of 8.
        const std::size_t first = -reinterpret_cast<std::uintptr_t>(part.data()) % 8;
        for (std::size_t i = first; i + 8 <= part.size(); i += 8) {
            std::uint64_t word = 0;
            std::memcpy(&word, part.data() + i, 8);
            ++words;
            for (const Range& range : mapped) CHECK(word < range.begin || word >= range.end || word % 8 != 0);
        }
    }
    CHECK(words > 5'000);
}

TEST(BlackBox, a_fault_while_another_is_written_waits_or_is_counted) {
    tools::ExampleRobots robots = tools::example_robots(true);
    tools::RigOptions options;
    options.world = robots.world;
    options.black_box = true;
    tools::CycleRig rig(robots.controller, robots.truth, options);
    const auto run = [&](int cycles) {
        for (int i = 0; i < cycles; ++i) {
            rig.step();
            CHECK(rig.box().snapshot());
        }
    };
    const auto stop = [&] {
        rig.host().emergency_stop();
        run(10);
        CHECK(rig.cycle().supervisor().fault() == Fault::emergency_stop_message);
        rig.host().clear_fault();
        run(100);
        CHECK(rig.cycle().supervisor().fault() == Fault::none);
    };
    run(1000);
    stop();
    CHECK(rig.box().record() == nullptr);
    run(1000);
    const task::BlackBox::Record* first = rig.box().record();
    CHECK(first != nullptr);
    CHECK_EQUAL(0U, first->further_faults);
    const std::uint64_t first_cycle = first->fault_cycle;
    stop();
    stop();
    run(2000);
    CHECK_EQUAL(first_cycle, rig.box().record()->fault_cycle);  // nobody touches what is being written
    rig.box().release();
    CHECK(rig.box().record() == nullptr);
    run(1);
    const task::BlackBox::Record* second = rig.box().record();
    CHECK(second != nullptr && second->fault_cycle > first_cycle);
    CHECK_EQUAL(1U, second->further_faults);
    CHECK(second->segments[0]->has_memory());
    CHECK_EQUAL(0U, rig.box().lost_faults());
    stop();
    run(42'000);
    CHECK_EQUAL(1U, rig.box().lost_faults());
    rig.box().release();
    run(1);
    CHECK(rig.box().record() == nullptr);
}

TEST(BlackBox, a_record_has_half_a_minute_and_the_next_one_begins_while_it_is_written) {
    tools::ExampleRobots robots = tools::example_robots(true);
    tools::RigOptions options;
    options.world = robots.world;
    options.black_box = true;
    tools::CycleRig rig(robots.controller, robots.truth, options);
    protocol::TrajectoryCommand command;
    command.shape = protocol::TrajectoryShape::figure_eight;
    int cycle = 0;
    const auto run = [&](int cycles) {
        for (int i = 0; i < cycles; ++i, ++cycle) {
            if (cycle == 300) rig.host().trajectory(command);
            if (cycle == 300) rig.host().mode(Mode::adaptive);
            rig.step();
            rig.box().snapshot();
        }
    };
    run(40'000);
    CHECK(rig.cycle().supervisor().mode() == Mode::adaptive);
    rig.host().emergency_stop();
    run(1100);
    const task::BlackBox::Record* first = rig.box().record();
    CHECK(first != nullptr);
    CHECK_EQUAL(task::BlackBox::kRecordSegments, first->segment_count);
    std::size_t most_bytes = 0;
    for (std::size_t i = 0; i + 1 < first->segment_count; ++i) {
        CHECK_EQUAL(task::BlackBox::kSegmentCycles,
                    first->segments[i + 1]->first_cycle - first->segments[i]->first_cycle);
        most_bytes = std::max(most_bytes, first->segments[i]->used_bytes);
    }
    std::printf("%.1f bytes a cycle\n", double(most_bytes) / double(task::BlackBox::kSegmentCycles));
    CHECK(first->fault_cycle - first->segments[0]->first_cycle > 29'000);

    // One segment is free; as the writer gives the others back, the next record has them.
    for (std::size_t i = 0; i < first->segment_count; ++i) {
        run(int(task::BlackBox::kSegmentCycles) - 100);
        rig.box().release_segment(i);
    }
    rig.box().release();
    rig.host().clear_fault();
    run(100);
    CHECK(rig.cycle().supervisor().fault() == Fault::none);
    rig.host().emergency_stop();
    run(1100);
    const task::BlackBox::Record* second = rig.box().record();
    CHECK(second != nullptr && second->segments[0]->has_memory());
    CHECK_EQUAL(task::BlackBox::kRecordSegments, second->segment_count);
    CHECK_EQUAL(0U, rig.box().lost_faults());
}

// The writer's thread copies while cycles come quicker than on any robot, and throws torn copies away.
TEST(BlackBox, the_memory_is_copied_while_the_loop_runs) {
    const ScratchFolder folder;
    const tools::ExampleRobots robots = tools::example_robots(true);
    tools::RigOptions options;
    options.world = robots.world;
    options.black_box = true;
    tools::CycleRig rig(robots.controller, robots.truth, options);
    task::BoxAbout about;
    about.build = task::build_identity();
    about.interface = {"can0", ""};
    about.drive_generation = robots.controller.drive.generation;
    task::BlackBoxWriter writer(rig.box(), folder.path(), about, [](const std::string&) {});
    {
        const task::BlackBoxThread thread(writer);
        for (int i = 0; i < 46'000; ++i) {
            if (i == 300) rig.host().velocity({0.3, 0.4});
            if (i == 300) rig.host().mode(Mode::velocity);
            if (i == 44'500) rig.host().emergency_stop();
            rig.step();
            if (i % 50 == 0) std::this_thread::sleep_for(std::chrono::microseconds(300));
        }
    }
    const auto files = files_in(folder.path());
    CHECK_EQUAL(1U, files.size());
    const Replayed r = replayed(text_of(files[0]));
    CHECK_TEXT(r.same(), r.why().c_str());
    CHECK(r.file.memory_cycle > 1);
    CHECK(r.result.sent > 2 * r.result.cycles * 9 / 10);  // it drove
}

TEST(BlackBox, the_newest_eight_stay_and_what_a_power_cut_has_left_goes) {
    const ScratchFolder folder;
    for (const int number : {3, 4, 5, 6, 7, 8, 9, 10, 11}) {
        std::ofstream(folder.path() + "/black-box-" + std::string(number < 10 ? "00000" : "0000") +
                      std::to_string(number) + "-overrun.log");
    }
    std::ofstream{folder.path() + "/.black-box-000012-overrun.log.abcdef"}.flush();
    std::ofstream{folder.path() + "/mine.log"}.flush();
    SimulationOptions options = chain::Scene::options({false, 0, 1}, 7);
    options.black_box = folder.path();
    Simulation sim(chain::identified(), chain::real().parameters, options);
    sim.run_for(0.3);
    sim.host().emergency_stop();
    sim.run_for(1.5);
    const auto files = files_in(folder.path());
    CHECK_EQUAL(9U, files.size());
    STRCMP_EQUAL("black-box-000005-overrun.log", files[0].filename().c_str());
    STRCMP_EQUAL("black-box-000012-emergency_stop_message.log", files[7].filename().c_str());
    STRCMP_EQUAL("mine.log", files[8].filename().c_str());
}

TEST(BlackBox, a_full_disk_is_said_and_leaves_nothing) {
    const ScratchFolder folder;
    rlimit before{};
    getrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, SIG_IGN);
    SimulationOptions options = chain::Scene::options({false, 0, 1}, 7);
    options.black_box = folder.path();
    Simulation sim(chain::identified(), chain::real().parameters, options);
    sim.run_for(0.5);
    sim.host().emergency_stop();
    const rlimit small{100'000, before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
    sim.run_for(1.5);
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, SIG_DFL);
    CHECK_EQUAL(1U, sim.black_boxes().size());
    STRCMP_CONTAINS("a black box is lost: cannot write", sim.black_boxes()[0].c_str());
    CHECK(files_in(folder.path()).empty());
}
