// Writing values back into a robot file: everything else stays as the user wrote it, but for comments behind
// values that are no longer there.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "firmware/task/robot_file.hpp"
#include "firmware/task/write_file.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using task::FileChange;

namespace {

const std::string kRobots = std::string(WHEELWRIGHT_SOURCE_DIR) + "/tools/robots/";

void expect_edit(const std::string& before, const FileChange& change, const std::string& after) {
    const task::EditResult edited = task::set_values(before, std::array{change});
    STRCMP_EQUAL("", edited.error.c_str());
    CHECK(edited.text.has_value());
    STRCMP_EQUAL(after.c_str(), edited.text->c_str());
}

// Bytes of `before` that are not in front of or behind the place where the texts differ.
std::size_t lost_bytes(const std::string& before, const std::string& after) {
    const std::size_t shorter = std::min(before.size(), after.size());
    std::size_t front = 0;
    while (front < shorter && before[front] == after[front]) ++front;
    std::size_t back = 0;
    while (back < shorter - front && before[before.size() - 1 - back] == after[after.size() - 1 - back])
        ++back;
    return before.size() - front - back;
}

std::string read(const std::string& path) {
    std::string text;
    STRCMP_EQUAL("", task::read_whole_file(path, text).c_str());
    return text;
}

class Folder {
  public:
    Folder() {
        std::string name = "/tmp/wheelwright_test_XXXXXX";
        path_ = ::mkdtemp(name.data());
    }
    ~Folder() {
        const std::string command = "rm -rf '" + path_ + "'";
        if (std::system(command.c_str()) != 0) std::printf("cannot remove %s\n", path_.c_str());
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    std::string file(const char* name) const { return path_ + "/" + name; }
    unsigned entries() const {
        const std::string command = "ls -A '" + path_ + "' | wc -l";
        std::FILE* pipe = ::popen(command.c_str(), "r");
        unsigned count = 0;
        if (pipe == nullptr || std::fscanf(pipe, "%u", &count) != 1) count = 999;
        if (pipe != nullptr) ::pclose(pipe);
        return count;
    }

  private:
    std::string path_;
};

}  // namespace

TEST_GROUP(RobotFileEdit){};

TEST(RobotFileEdit, AValueIsReplacedAndNothingElse) {
    expect_edit("# my robot\n[geometry] # tape\n  track_m   =  0.32   # wall to wall\n\n# end\n",
                {"geometry.track_m", 0.3187},
                "# my robot\n[geometry] # tape\n  track_m   =  0.3187   # was 0.32: wall to wall\n\n# end\n");
    expect_edit("[drive.left]\nnode = 0x01 # hex\n", {"drive.left.node", std::int64_t{17}},
                "[drive.left]\nnode = 17 # was 0x01: hex\n");
    expect_edit("[safety]\nover_speed_reaction = 'coast'\n",
                {"safety.over_speed_reaction", std::string("ramp")},
                "[safety]\nover_speed_reaction = \"ramp\"\n");
    expect_edit("[drive]\nwatchdog_assured=true#!\n", {"drive.watchdog_assured", false},
                "[drive]\nwatchdog_assured=false#was true: !\n");
}

TEST(RobotFileEdit, ASpellingThatAlreadyMeansTheValueStays) {
    expect_edit("[geometry]\ntrack_m = 320e-3\n", {"geometry.track_m", 0.32},
                "[geometry]\ntrack_m = 320e-3\n");
    expect_edit("[limits]\ntorque_Nm = 5\n", {"limits.torque_Nm", 5.0}, "[limits]\ntorque_Nm = 5\n");
}

// The reader of a saved file must not take the reason for the former value for that of the new one.
TEST(RobotFileEdit, ACommentBehindAValueThatChangesTellsOfTheFormerOne) {
    const std::string once = "[dynamics]\nk7_per_kg_m = 1.3  # was 1.40855: 1 / (9.466 kg x 0.075 m)\n";
    expect_edit("[dynamics]\nk7_per_kg_m = 1.40855  # 1 / (9.466 kg x 0.075 m)\n",
                {"dynamics.k7_per_kg_m", 1.3}, once);
    expect_edit(once, {"dynamics.k7_per_kg_m", 1.2},
                "[dynamics]\nk7_per_kg_m = 1.2  # was 1.40855: 1 / (9.466 kg x 0.075 m)\n");
    expect_edit(once, {"dynamics.k7_per_kg_m", 1.3}, once);
    expect_edit("[drive]\nleft = { node = 1, x = \"\\\"#1\", y = '#2' }\t## one\r\n",
                {"drive.left.node", std::int64_t{3}},
                "[drive]\nleft = { node = 3, x = \"\\\"#1\", y = '#2' }\t## was 1: one\r\n");
    expect_edit("[geometry]\ntrack_m = 0.3 #\n# next\n", {"geometry.track_m", 0.29},
                "[geometry]\ntrack_m = 0.29 #\n# next\n");
}

TEST(RobotFileEdit, PlacesAreRightBehindOtherLetters) {
    expect_edit(
        "# Größe µ\n[geometry] # ü\nwheel_radius_m = { left = 0.07, right = 0.08 } # é\n",
        {"geometry.wheel_radius_m.right", 0.0791},
        "# Größe µ\n[geometry] # ü\nwheel_radius_m = { left = 0.07, right = 0.0791 } # was 0.08: é\n");
    expect_edit("robot = { name = \"Mäuschen 🐭\" } # 🐭\ngeometry = { track_m = 0.3 }\n",
                {"geometry.track_m", 0.29},
                "robot = { name = \"Mäuschen 🐭\" } # 🐭\ngeometry = { track_m = 0.29 }\n");
    expect_edit("\xEF\xBB\xBFgeometry.track_m = 0.3\n", {"geometry.track_m", 0.29},
                "\xEF\xBB\xBFgeometry.track_m = 0.29\n");
    expect_edit("[geometry]\r\ntrack_m = 0.3\r\n[drive]\r\n", {"drive.generation", std::int64_t{5}},
                "[geometry]\r\ntrack_m = 0.3\r\n[drive]\r\ngeneration = 5\r\n");
}

TEST(RobotFileEdit, AMissingKeyGoesToTheEndOfItsTable) {
    expect_edit("[dynamics]\n  k7_per_kg_m = 1.4 # K7\n\n# the drives\n[drive]\ngeneration = 6\n",
                {"dynamics.k8_per_kg_m2", 6.7},
                "[dynamics]\n  k7_per_kg_m = 1.4 # K7\n  k8_per_kg_m2 = 6.7\n\n# the "
                "drives\n[drive]\ngeneration = 6\n");
    expect_edit("[dynamics]\n# nothing yet\n", {"dynamics.k8_per_kg_m2", 6.7},
                "[dynamics]\nk8_per_kg_m2 = 6.7\n# nothing yet\n");
    expect_edit("[dynamics]", {"dynamics.k8_per_kg_m2", 6.7}, "[dynamics]\nk8_per_kg_m2 = 6.7");
    expect_edit("[geometry]\nwheel_radius_m = { left = 0.07 }\n", {"geometry.wheel_radius_m.right", 0.08},
                "[geometry]\nwheel_radius_m = { left = 0.07, right = 0.08 }\n");
    expect_edit("[geometry]\nwheel_radius_m = {}\n", {"geometry.wheel_radius_m.right", 0.08},
                "[geometry]\nwheel_radius_m = { right = 0.08 }\n");
    expect_edit("geometry = { track_m = 0.3 }\n", {"geometry.wheel_radius_m.right", 0.08},
                "geometry = { track_m = 0.3, wheel_radius_m.right = 0.08 }\n");
    expect_edit("[drive]\nleft.node = 3 # three\nright.node = 4\n", {"drive.left.sign", std::int64_t{-1}},
                "[drive]\nleft.node = 3 # three\nleft.sign = -1\nright.node = 4\n");
    expect_edit("drive.left.node = 3\n", {"drive.left.sign", std::int64_t{-1}},
                "drive.left.node = 3\ndrive.left.sign = -1\n");
}

TEST(RobotFileEdit, AMissingTableGoesToTheEndOfTheFile) {
    expect_edit("[geometry]\ntrack_m = 0.3\n", {"dynamics.k7_per_kg_m", 1.5},
                "[geometry]\ntrack_m = 0.3\n\n[dynamics]\nk7_per_kg_m = 1.5\n");
    expect_edit("[drive.left]\nnode = 3", {"drive.generation", std::int64_t{5}},
                "[drive.left]\nnode = 3\n\n[drive]\ngeneration = 5\n");
    expect_edit("", {"effects.coulomb_friction.active", true}, "[effects.coulomb_friction]\nactive = true\n");
}

TEST(RobotFileEdit, NumbersAreAsShortAsTheyCanBe) {
    STRCMP_EQUAL("0.1", task::shortest_number(0.1).c_str());
    STRCMP_EQUAL("5.0", task::shortest_number(5).c_str());
    STRCMP_EQUAL("-0.0", task::shortest_number(-0.0).c_str());
    STRCMP_EQUAL("1e-05", task::shortest_number(1e-5).c_str());
    STRCMP_EQUAL("0.30000000000000004", task::shortest_number(0.1 + 0.2).c_str());
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> exponent(-300, 300);
    for (int i = 0; i < 2000; ++i) {
        const double value = std::pow(10.0, exponent(random)) * (i % 2 == 0 ? 1 : -1);
        DOUBLES_EQUAL(value, std::strtod(task::shortest_number(value).c_str(), nullptr), 0);
    }
}

// A float that came over the bus is written as the user typed it.
TEST(RobotFileEdit, ValuesFromTheBusHaveAFloatsDigits) {
    const auto change = task::file_change(0x0003, static_cast<double>(0.317F));
    CHECK(change.has_value());
    STRCMP_EQUAL("geometry.track_m", change->key.c_str());
    DOUBLES_EQUAL(0.317, std::get<double>(change->value), 0);
    const auto exact = task::file_change(0x0082, 1.4085512345678);
    DOUBLES_EQUAL(1.4085512345678, std::get<double>(exact->value), 0);
    STRCMP_EQUAL("ramp", std::get<std::string>(task::file_change(0x0069, 1)->value).c_str());
    CHECK(std::get<bool>(task::file_change(0x0037, 1)->value));
    CHECK(std::get<std::int64_t>(task::file_change(0x0048, 9)->value) == 9);
    STRCMP_EQUAL("effects.coulomb_friction.right_Nm",
                 task::file_change(model::effect_index(1, 1), 0.25)->key.c_str());
    STRCMP_EQUAL("effects.viscous_friction.active",
                 task::file_change(model::effect_index(0, model::kEffectActiveSlot), 1)->key.c_str());
    CHECK_FALSE(task::file_change(0x0FFF, 1).has_value());
    CHECK_FALSE(task::file_change(0x4FFF, 1).has_value());
    CHECK_FALSE(task::file_change(0x0069, 7).has_value());
}

TEST(RobotFileEdit, WhatCannotBeSetIsRefusedAndTheTextIsNotGiven) {
    const auto refused = [](const std::string& text, const FileChange& change) {
        const task::EditResult edited = task::set_values(text, std::array{change});
        CHECK_FALSE(edited.text.has_value());
        CHECK(!edited.error.empty());
    };
    refused("[geometry\n", {"geometry.track_m", 0.3});
    refused("[geometry]\ntrack_m = [1, 2]\n", {"geometry.track_m", 0.3});
    refused("geometry = 3\n", {"geometry.track_m", 0.3});
    refused("", {"geometry.track_m", std::nan("")});
    refused("", {"track_m", 0.3});
    refused("", {"geometry..x", 0.3});
    refused("", {"geo metry.x", 0.3});
}

// Each parameter in turn set in each example: the text in front and behind stays, the value is there, and all
// other values are what they were.
TEST(RobotFileEdit, EveryParameterCanBeSetInEveryExample) {
    unsigned edits = 0;
    for (const char* name : {"default", "simulated", "light", "heavy"}) {
        const std::string before = read(kRobots + name + ".toml");
        const task::RobotFileResult old = task::parse_robot_file(before, name);
        for (const model::ParameterInfo& info : model::parameter_table()) {
            double value = info.minimum + 0.37 * (info.maximum - info.minimum);
            if (info.kind != model::ParameterKind::real) value = std::floor(value);
            const auto change = task::file_change(info.index, value);
            CHECK(change.has_value());
            const task::EditResult edited = task::set_values(before, std::array{*change});
            STRCMP_EQUAL("", edited.error.c_str());
            CHECK(lost_bytes(before, *edited.text) <= 60);  // the old value and the space behind it at most
            ++edits;
            const task::RobotFileResult fresh = task::parse_robot_file(*edited.text, name);
            if (!fresh.robot.has_value()) continue;  // contradicts another value, or [mass]
            DOUBLES_EQUAL(value, info.get(fresh.robot->parameters), std::abs(value) * 1e-7);
            for (const model::ParameterInfo& other : model::parameter_table()) {
                // K6 may follow from the others, and they from the geometry
                if (other.index == info.index || other.key.starts_with("dynamics.")) continue;
                DOUBLES_EQUAL(other.get(old.robot->parameters), other.get(fresh.robot->parameters), 0);
            }
        }
    }
    std::printf("%u edits\n", edits);
}

// Many values one after the other, in random order, with random layout noise in the file.
TEST(RobotFileEdit, RandomEditsKeepEveryLineThatIsNotTheirs) {
    std::mt19937 random(20240611);
    const std::string original = read(kRobots + "heavy.toml");
    for (int round = 0; round < 20; ++round) {
        std::string text;
        for (const char c : original) {
            text += c;
            if (c == '\n' && random() % 7 == 0)
                text.append("# note = [x] \"").append(random() % 10, '-').append("\n");
            if (c == '\n' && random() % 9 == 0) text += "\n";
        }
        const std::string start = text;
        std::vector<FileChange> changes;
        for (int i = 0; i < 12; ++i) {
            const auto table = model::parameter_table();
            const model::ParameterInfo& info = table[random() % table.size()];
            double value =
                info.minimum + (info.maximum - info.minimum) * static_cast<double>(random() % 1000) / 1000;
            if (info.kind != model::ParameterKind::real) value = std::floor(value);
            changes.push_back(*task::file_change(info.index, value));
            const task::EditResult edited = task::set_values(text, std::array{changes.back()});
            STRCMP_EQUAL("", edited.error.c_str());
            CHECK(lost_bytes(text, *edited.text) <= 60);
            text = *edited.text;
        }
        const task::EditResult at_once = task::set_values(start, changes);
        CHECK(at_once.text.has_value());
        STRCMP_EQUAL(text.c_str(), at_once.text->c_str());
    }
}

// Files that a text editor or a bad disk has damaged: never a crash, and never a byte lost.
TEST(RobotFileEdit, DamagedFilesAreRefusedOrEditedWithoutLoss) {
    std::mt19937 random(99);
    const std::string whole = read(kRobots + "default.toml");
    const std::string original = whole.substr(0, whole.find("[dynamics]"));
    unsigned refused = 0;
    unsigned done = 0;
    for (int round = 0; round < 1500; ++round) {
        std::string text = original;
        const auto mutations = 1 + random() % 3;
        for (auto i = mutations; i > 0; --i) {
            const std::size_t at = random() % text.size();
            switch (random() % 4) {
                case 0:
                    text[at] = static_cast<char>(random() % 256);
                    break;
                case 1:
                    text.erase(at, 1 + random() % 20);
                    break;
                case 2:
                    text.insert(at, 1, "[]{}=\"'#.\n\r\t,"[random() % 13]);
                    break;
                default:
                    text.insert(at, text.substr(random() % text.size(), random() % 40));
                    break;
            }
            if (text.empty()) text.push_back('\n');
        }
        const task::RobotFileResult parsed = task::parse_robot_file(text, "damaged");
        CHECK(parsed.robot.has_value() == parsed.problems.empty());
        const task::EditResult edited =
            task::set_values(text, std::array{FileChange{"geometry.track_m", 0.3123}});
        if (!edited.text.has_value()) {
            ++refused;
            continue;
        }
        ++done;
        const std::size_t lost = lost_bytes(text, *edited.text);
        CHECK_TEXT(lost <= 60, text.c_str());
    }
    std::printf("%u refused, %u edited\n", refused, done);
    CHECK(refused > 100);
    CHECK(done > 100);
}

TEST(RobotFileEdit, SavingChecksTheResultAndKeepsTheFileWhenItWouldBeBad) {
    const Folder folder;
    const std::string path = folder.file("robot.toml");
    const std::string text = "# mine\n[limits]\nspeed_m_per_s = 2.0 # slow\n";
    STRCMP_EQUAL("", task::write_whole_file(path, text).c_str());
    const std::array good{FileChange{"limits.speed_m_per_s", 1.5}, FileChange{"dynamics.k7_per_kg_m", 1.25}};
    STRCMP_EQUAL("", task::save_robot_file(path, good).c_str());
    STRCMP_EQUAL("# mine\n[limits]\nspeed_m_per_s = 1.5 # was 2.0: slow\n\n[dynamics]\nk7_per_kg_m = 1.25\n",
                 read(path).c_str());
    const std::string saved = read(path);
    const std::array bad{FileChange{"limits.speed_m_per_s", 15.0}};  // above the over-speed limit
    CHECK(task::save_robot_file(path, bad).find("not saved") != std::string::npos);
    STRCMP_EQUAL(saved.c_str(), read(path).c_str());
    const std::array unknown{FileChange{"limits.warp", 1.0}};
    CHECK(task::save_robot_file(path, unknown).find("unknown key") != std::string::npos);
    CHECK(task::save_robot_file(folder.file("other.toml"), good).find("cannot open") != std::string::npos);
    LONGS_EQUAL(1, folder.entries());
}

TEST_GROUP(WriteFile){};

TEST(WriteFile, PermissionsAndLinksAreKeptAndNothingIsLeftBehind) {
    const Folder folder;
    const std::string path = folder.file("a.toml");
    const std::string link = folder.file("link.toml");
    STRCMP_EQUAL("", task::write_whole_file(path, "old").c_str());
    LONGS_EQUAL(0, ::chmod(path.c_str(), 0640));
    LONGS_EQUAL(0, ::symlink("a.toml", link.c_str()));
    STRCMP_EQUAL("", task::write_whole_file(link, "new").c_str());
    STRCMP_EQUAL("new", read(path).c_str());
    struct stat about {};
    LONGS_EQUAL(0, ::lstat(link.c_str(), &about));
    CHECK(S_ISLNK(about.st_mode));
    LONGS_EQUAL(0, ::stat(path.c_str(), &about));
    LONGS_EQUAL(0640, about.st_mode & 07777);
    LONGS_EQUAL(2, folder.entries());
}

TEST(WriteFile, FailureIsOneSentenceAndKeepsTheOldFile) {
    const Folder folder;
    CHECK(task::write_whole_file(folder.file("no/such/folder.toml"), "x").find("No such file") !=
          std::string::npos);
    LONGS_EQUAL(0, ::mkdir(folder.file("d").c_str(), 0755));
    CHECK(task::write_whole_file(folder.file("d"), "x").find("not a regular file") != std::string::npos);
    if (::geteuid() != 0) {  // root may do everything
        const std::string path = folder.file("d/a.toml");
        STRCMP_EQUAL("", task::write_whole_file(path, "old").c_str());
        LONGS_EQUAL(0, ::chmod(folder.file("d").c_str(), 0555));
        CHECK(task::write_whole_file(path, "new").find("must be writable") != std::string::npos);
        STRCMP_EQUAL("old", read(path).c_str());
        LONGS_EQUAL(0, ::chmod(folder.file("d").c_str(), 0755));
    }
    // A file system that takes no new files, also from root.
    CHECK(!task::write_whole_file("/proc/wheelwright.toml", "x").empty());
}
