// `wheelwright key`: the key that lets a host arm a robot.
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "firmware/task/key_file.hpp"
#include "firmware/task/robot_file.hpp"
#include "hal/linux/cryptography.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/command_line.hpp"

namespace wheelwright::tools {
namespace {

int complain(const std::string& text) {
    std::fprintf(stderr, "wheelwright key: %s\n", text.c_str());
    return kUsage;
}

int generate(const std::string& path, const std::string& robot) {
    if (const std::string wrong = task::robot_name_error(robot); !wrong.empty()) {
        return complain("--robot: " + wrong);
    }
    task::KeyFile key;
    key.robot = robot;
    auto random = hal::make_random();
    if (!random || !random.value()->fill(key.key)) {
        complain(random ? "there are no random numbers" : random.error().message);
        return kMachineLacks;
    }
    if (const std::string wrong = task::write_key_file(path, key); !wrong.empty()) return complain(wrong);
    std::printf("%s: a new key for robot %s\n", path.c_str(), robot.c_str());
    return kDone;
}

int check(const std::string& path) {
    task::KeyFile key;
    if (const std::string wrong = task::read_key_file(path, key); !wrong.empty()) return complain(wrong);
    std::printf("%s: good, for robot %s\n", path.c_str(), key.robot.c_str());
    return kDone;
}

int install(const std::string& path, const std::string& robot_file) {
    if (const int status = check(path); status != kDone) return status;
    std::error_code error;
    const std::filesystem::path whole = std::filesystem::absolute(path, error);
    const std::array changes{task::FileChange{"arming.key_file", whole.lexically_normal().string()}};
    if (const std::string wrong = task::save_robot_file(robot_file, changes); !wrong.empty()) {
        return complain(wrong);
    }
    std::printf("%s: arming.key_file names it; wheelwrightd reads it when it starts\n", robot_file.c_str());
    return kDone;
}

}  // namespace

void add_key(const CommandLine& program, Run& run) {
    struct Options {
        std::string file, robot = "robot", config;
    };
    const auto options = std::make_shared<Options>();
    const CommandLine key =
        program.add_subcommand("key", "Make, check and install the key without which a robot is not armed");
    key.require_subcommand();
    key.footer("docs/driving.md says what a key is good for, and what it does not protect from.");
    const CommandLine make =
        key.add_subcommand("generate", "Make a new key, in a file that only you can read");
    make.add_option("FILE", options->file, "Key file; must not exist").required();
    make.add_option("--robot", options->robot, "Name of the robot: the key's answers are good for it alone")
        .show_default();
    make.callback([=, &run] { run = [=] { return generate(options->file, options->robot); }; });
    const CommandLine look = key.add_subcommand("check", "Is this a key file that nobody else can read?");
    look.add_option("FILE", options->file, "Key file").required();
    look.callback([=, &run] { run = [=] { return check(options->file); }; });
    const CommandLine put = key.add_subcommand("install", "Name the key file in a robot file");
    put.add_option("FILE", options->file, "Key file").required();
    put.add_option("--config", options->config, "Robot file (arming.key_file)").required();
    put.callback([=, &run] { run = [=] { return install(options->file, options->config); }; });
}

}  // namespace wheelwright::tools
