#include "firmware/task/black_box_writer.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <new>
#include <string_view>
#include <utility>
#include <vector>

#include "firmware/task/write_file.hpp"

namespace wheelwright::task {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPrefix = "black-box-";
constexpr std::chrono::milliseconds kLook{20};

struct Numbered {
    unsigned long number;
    fs::path path;
};

// The boxes of a directory, oldest first.
std::vector<Numbered> boxes_in(const std::string& directory) {
    std::vector<Numbered> found;
    std::error_code failed;
    for (const auto& entry : fs::directory_iterator(directory, failed)) {
        const std::string name = entry.path().filename();
        if (!name.starts_with(kPrefix) || !name.ends_with(".log")) continue;
        unsigned long number = 0;
        const auto [end, error] =
            std::from_chars(name.data() + kPrefix.size(), name.data() + name.size(), number);
        if (error == std::errc{} && *end == '-') found.push_back({number, entry.path()});
    }
    std::sort(found.begin(), found.end(),
              [](const Numbered& a, const Numbered& b) { return a.number < b.number; });
    return found;
}

}  // namespace

BlackBoxWriter::BlackBoxWriter(BlackBox& box, std::string directory, BoxAbout about, Say say, Offset offset)
    : box_(box),
      directory_(std::move(directory)),
      about_(std::move(about)),
      say_(std::move(say)),
      offset_(offset) {}

std::string BlackBoxWriter::prepare(const std::string& directory) {
    std::error_code failed;
    fs::create_directories(directory, failed);
    if (failed) return "cannot make the directory " + directory + ": " + failed.message();
    std::vector<fs::path> left;
    for (const auto& entry : fs::directory_iterator(directory, failed)) {
        const std::string name = entry.path().filename();
        if (name.starts_with('.') && name.find(kPrefix) == 1) left.push_back(entry.path());
    }
    if (failed) return "cannot read the directory " + directory + ": " + failed.message();
    for (const fs::path& path : left) fs::remove(path, failed);
    return "";
}

void BlackBoxWriter::step() {
    // The loop sleeps for most of each millisecond: a second attempt is rare.
    for (int attempt = 0; attempt < 10 && !box_.snapshot(); ++attempt) {
        std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    if (const BlackBox::Record* record = box_.record()) {
        try {
            write(*record);
        } catch (const std::bad_alloc&) {
            say_("a black box is lost: no memory to write it");
        }
        box_.release();
    }
    if (const std::uint32_t lost = box_.lost_faults(); lost != lost_) {
        say_(std::to_string(lost - lost_) +
             " fault(s) came while a black box was being written, and are in none");
        lost_ = lost;
    }
}

void BlackBoxWriter::finish() {
    step();
    box_.flush();
    step();
}

void BlackBoxWriter::write(const BlackBox::Record& record) {
    const std::vector<Numbered> before = boxes_in(directory_);
    std::array<char, 32> number{};
    std::snprintf(number.data(), number.size(), "%06lu-", before.empty() ? 1 : before.back().number + 1);
    const std::string path = directory_ + "/" + std::string(kPrefix) + number.data() +
                             std::string(protocol::to_string_view(record.fault)) + ".log";
    about_.offset_ns = offset_ == nullptr ? 0 : offset_() / 1000 * 1000;
    const std::string problem = write_whole_file(path, [&](const Pieces& write) {
        return write_black_box(record, box_.memory_bytes(), about_, write,
                               [&](std::size_t segment) { box_.release_segment(segment); });
    });
    if (!problem.empty()) {
        say_("a black box is lost: " + problem);
        return;
    }
    say_("black box: " + path);
    std::error_code failed;
    for (std::size_t i = 0; i + kBoxesKept < before.size() + 1; ++i) fs::remove(before[i].path, failed);
}

BlackBoxThread::BlackBoxThread(BlackBoxWriter& writer) : writer_(writer), thread_([this] { run(); }) {}

BlackBoxThread::~BlackBoxThread() {
    stop_ = true;
    thread_.join();
}

void BlackBoxThread::run() {
    constexpr int kNice = 10;
    setpriority(PRIO_PROCESS, 0, kNice);  // of this thread
    while (!stop_) {
        writer_.step();
        std::this_thread::sleep_for(kLook);
    }
    writer_.finish();
}

}  // namespace wheelwright::task
