#include "firmware/task/key_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <string_view>

#include "firmware/protocol/arming_code.hpp"

namespace wheelwright::task {
namespace {

// Text that held a key.
struct Secret {
    std::array<char, 1024> text{};
    std::size_t length = 0;

    Secret() = default;
    ~Secret() { explicit_bzero(text.data(), text.size()); }
    Secret(const Secret&) = delete;
    Secret& operator=(const Secret&) = delete;
};

std::string system_text(int error) {
    std::array<char, 128> buffer{};
    return strerror_r(error, buffer.data(), buffer.size());
}

// As in `chmod 600`.
std::string octal(mode_t mode) {
    std::array<char, 8> text{};
    std::snprintf(text.data(), text.size(), "%04o", static_cast<unsigned>(mode & 07777U));
    return text.data();
}

std::string owner_error(const struct stat& about) {
    if (!S_ISREG(about.st_mode)) return "expected a file on a disk";
    if ((about.st_mode & 0077U) != 0) {
        return "others may use this key: found mode " + octal(about.st_mode) + ", expected 0600 (chmod 600)";
    }
    if (about.st_uid != ::geteuid() && about.st_uid != 0) {
        return "belongs to user " + std::to_string(about.st_uid) + ", expected " +
               std::to_string(::geteuid()) + ", who runs this program, or root";
    }
    return "";
}

std::string read_secret(int descriptor, Secret& out) {
    while (out.length < out.text.size()) {
        const ssize_t got = ::read(descriptor, out.text.data() + out.length, out.text.size() - out.length);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return "cannot read: " + system_text(errno);
        if (got == 0) return "";
        out.length += static_cast<std::size_t>(got);
    }
    return "is longer than a key file can be";
}

bool read_hex(std::string_view text, std::array<std::uint8_t, 16>& key) {
    if (text.size() != 2 * key.size()) return false;
    for (std::size_t i = 0; i < key.size(); ++i) {
        const char* const first = text.data() + 2 * i;
        const auto [end, error] = std::from_chars(first, first + 2, key[i], 16);
        if (error != std::errc() || end != first + 2) return false;
    }
    return true;
}

std::string parse(std::string_view text, KeyFile& out) {
    bool has_key = false;
    for (int line = 1; !text.empty(); ++line) {
        const std::string_view content = text.substr(0, text.find('\n'));
        text.remove_prefix(std::min(text.size(), content.size() + 1));
        const std::string where = "line " + std::to_string(line) + ": ";
        if (content.empty() || content.front() == '#') continue;
        if (content.starts_with("robot ") && out.robot.empty()) {
            out.robot = content.substr(6);
            if (const std::string wrong = robot_name_error(out.robot); !wrong.empty()) return where + wrong;
        } else if (content.starts_with("key ") && !has_key) {
            if (!read_hex(content.substr(4), out.key)) return where + "expected 32 hexadecimal digits";
            has_key = true;
        } else {
            return where + "expected one line `robot NAME` and one line `key HEX`";
        }
    }
    if (out.robot.empty()) return "expected a line `robot NAME`";
    return has_key ? "" : "expected a line `key HEX`";
}

}  // namespace

KeyFile::~KeyFile() { explicit_bzero(key.data(), key.size()); }

std::string robot_name_error(const std::string& name) {
    bool printable = !name.empty() && name.front() != ' ' && name.back() != ' ';
    for (const char byte : name) printable = printable && static_cast<unsigned char>(byte) >= 0x20;
    if (printable && name.size() <= protocol::kMostRobotName) return "";
    return "expected a name of 1 to " + std::to_string(protocol::kMostRobotName) +
           " bytes, without control characters and spaces around it";
}

std::string read_key_file(const std::string& path, KeyFile& out) {
    // A pipe would make this wait for its writer.
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0) return path + ": cannot open: " + system_text(errno);
    Secret secret;
    struct stat about {};
    std::string wrong = ::fstat(file, &about) == 0 ? owner_error(about) : system_text(errno);
    if (wrong.empty()) wrong = read_secret(file, secret);
    ::close(file);
    if (wrong.empty()) wrong = parse({secret.text.data(), secret.length}, out);
    return wrong.empty() ? "" : path + ": " + wrong;
}

std::string write_key_file(const std::string& path, const KeyFile& key) {
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (file < 0) return path + ": cannot make: " + system_text(errno);
    Secret secret;
    const auto add = [&secret](std::string_view text) {
        std::memcpy(secret.text.data() + secret.length, text.data(), text.size());
        secret.length += text.size();
    };
    add("# Whoever has this file can arm the robot. For its owner alone (mode 0600), and for no "
        "repository.\n");
    add("robot " + key.robot + "\nkey ");
    constexpr std::string_view kDigits = "0123456789abcdef";
    for (const std::uint8_t byte : key.key) {
        add(kDigits.substr(byte >> 4U, 1));
        add(kDigits.substr(byte & 15U, 1));
    }
    add("\n");
    bool done = ::write(file, secret.text.data(), secret.length) == static_cast<ssize_t>(secret.length) &&
                ::fsync(file) == 0;
    const int error = errno;
    done = ::close(file) == 0 && done;
    if (done) return "";
    ::unlink(path.c_str());
    return path + ": cannot write: " + system_text(error);
}

}  // namespace wheelwright::task
