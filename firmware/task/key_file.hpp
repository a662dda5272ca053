// The key that lets a host arm a robot, in a file of its own that nobody else may read:
//
//     robot NAME       of the robot it belongs to: answers are bound to it
//     key HEX          32 hexadecimal digits
//
// Empty lines and lines that begin with # do not count. No message of these functions holds the key.
//
// Everything here allocates and waits for files: start-up and tools only.
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace wheelwright::task {

// Wiped when it goes.
struct KeyFile {
    KeyFile() = default;
    ~KeyFile();
    KeyFile(const KeyFile&) = delete;
    KeyFile& operator=(const KeyFile&) = delete;

    std::string robot;
    std::array<std::uint8_t, 16> key{};
};

// "" when done, else one sentence that begins with the path. Refused: a file that others than its owner may
// read or write, or that belongs neither to the user of this process nor to root.
std::string read_key_file(const std::string& path, KeyFile& out);

// Makes the file, for its owner alone; never over one that exists. As above.
std::string write_key_file(const std::string& path, const KeyFile& key);

// "" when this can be a robot's name, else what is expected.
std::string robot_name_error(const std::string& name);

}  // namespace wheelwright::task
