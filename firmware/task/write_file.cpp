#include "firmware/task/write_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>

namespace wheelwright::task {
namespace {

constexpr std::size_t kLargest = std::size_t{16} << 20;

std::string system_text(int error) {
    std::array<char, 128> buffer{};
    return strerror_r(error, buffer.data(), buffer.size());
}

std::string because(const std::string& what, const std::string& path, int error) {
    std::string text = what + " " + path + ": " + system_text(error);
    if (error == EACCES || error == EPERM || error == EROFS) {
        text += "; the directory must be writable for this user, as the file is replaced whole";
    }
    return text;
}

class Descriptor {
  public:
    explicit Descriptor(int value) : value_(value) {}
    ~Descriptor() { close(); }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;

    int get() const { return value_; }
    bool valid() const { return value_ >= 0; }
    bool close() {
        if (value_ < 0) return true;
        const int result = ::close(value_);
        value_ = -1;
        return result == 0;
    }

  private:
    int value_;
};

bool write_all(int descriptor, std::string_view text) {
    while (!text.empty()) {
        const ssize_t written = ::write(descriptor, text.data(), text.size());
        if (written < 0) {
            if (errno == EINTR) continue;
            return false;
        }
        text.remove_prefix(static_cast<std::size_t>(written));
    }
    return true;
}

}  // namespace

std::string write_whole_file(const std::string& path, std::string_view text) {
    return write_whole_file(path, [text](const Pieces& write) { return write(text); });
}

std::string write_whole_file(const std::string& path, const std::function<bool(const Pieces&)>& produce) {
    std::string target = path;
    std::array<char, PATH_MAX> resolved{};
    if (::realpath(path.c_str(), resolved.data()) != nullptr) {
        target = resolved.data();
    } else if (errno != ENOENT) {
        return because("cannot reach", path, errno);
    }
    const std::size_t slash = target.rfind('/');
    const std::string directory = slash == std::string::npos ? "." : target.substr(0, slash + 1);
    const std::string name = slash == std::string::npos ? target : target.substr(slash + 1);

    struct stat old {};
    const bool exists = ::stat(target.c_str(), &old) == 0;
    if (exists && !S_ISREG(old.st_mode)) return "cannot write " + path + ": it is not a regular file";
    // Replacing by rename would get round a file's own write protection.
    if (exists && ::access(target.c_str(), W_OK) != 0) {
        return "cannot write " + path + ": " + system_text(errno);
    }

    std::string temporary = directory + (directory.back() == '/' ? "." : "/.") + name + ".XXXXXX";
    Descriptor file(::mkostemp(temporary.data(), O_CLOEXEC));
    if (!file.valid()) return because("cannot make a temporary file in", directory, errno);
    const auto fail = [&](const std::string& what) {
        const std::string message = because(what, target, errno);
        ::unlink(temporary.c_str());
        return message;
    };
    const mode_t mode = exists ? old.st_mode & 07777U : mode_t{0644};
    if (exists && (old.st_uid != ::geteuid() || old.st_gid != ::getegid())) {
        // Only root can keep a foreign owner; for others the file becomes theirs, as any editor would do.
        if (::fchown(file.get(), old.st_uid, old.st_gid) != 0) errno = 0;
    }
    if (::fchmod(file.get(), mode) != 0) return fail("cannot set the permissions of");
    if (!produce([&file](std::string_view piece) { return write_all(file.get(), piece); })) {
        return fail("cannot write");
    }
    if (::fsync(file.get()) != 0) return fail("cannot flush");
    if (!file.close()) return fail("cannot close");
    if (::rename(temporary.c_str(), target.c_str()) != 0) return fail("cannot replace");

    const Descriptor folder(::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!folder.valid() || ::fsync(folder.get()) != 0) {
        // The new text is in place; only its survival of a power cut is not certain.
        if (errno != EINVAL) return because("written, but cannot flush the directory", directory, errno);
    }
    return "";
}

std::string read_whole_file(const std::string& path, std::string& text) {
    text.clear();
    // A pipe would make this wait until somebody writes into it, which may be never.
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (!file.valid()) return "cannot open: " + system_text(errno);
    struct stat about {};
    if (::fstat(file.get(), &about) != 0) return "cannot read: " + system_text(errno);
    if (S_ISDIR(about.st_mode)) return "is a directory";
    if (!S_ISREG(about.st_mode)) return "is a pipe or a device, expected a file on a disk";
    std::array<char, 65536> buffer{};
    for (;;) {
        const ssize_t got = ::read(file.get(), buffer.data(), buffer.size());
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return "cannot read: " + system_text(errno);
        if (got == 0) return "";
        text.append(buffer.data(), static_cast<std::size_t>(got));
        if (text.size() > kLargest) return "is larger than 16 MiB";
    }
}

}  // namespace wheelwright::task
