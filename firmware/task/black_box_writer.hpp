// Writes the records of a black box to files, far from the cycle's thread:
// DIR/black-box-000012-over_speed.log. A file is there whole or not at all, also after a power cut. Of those
// in the directory the newest kBoxesKept stay. Where the disk is full or broken it says so, and the loop does
// not notice.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <thread>

#include "firmware/task/black_box.hpp"
#include "firmware/task/black_box_file.hpp"

namespace wheelwright::task {

inline constexpr std::size_t kBoxesKept = 8;

class BlackBoxWriter {
  public:
    using Say = std::function<void(const std::string&)>;
    // What is known when a file is written.
    using Offset = std::int64_t (*)();  // BoxAbout::offset_ns; null: 0

    // `say` hears one sentence for each file written, or not. All outlive the writer.
    BlackBoxWriter(BlackBox& box, std::string directory, BoxAbout about, Say say, Offset offset = nullptr);

    // Makes the directory, and removes what a power cut has left in it. "" or why not.
    static std::string prepare(const std::string& directory);

    // Does what there is to do: copies memory, writes a record. Call some ten times a second.
    void step();
    // After the last cycle: also what still waits.
    void finish();

  private:
    void write(const BlackBox::Record& record);

    BlackBox& box_;
    std::string directory_;
    BoxAbout about_;
    Say say_;
    Offset offset_;
    std::uint32_t lost_ = 0;
};

// The writer on a thread of its own, of low priority.
class BlackBoxThread {
  public:
    // Start it after the process's signal mask is set, and before it becomes real-time: a thread inherits
    // both.
    explicit BlackBoxThread(BlackBoxWriter& writer);
    ~BlackBoxThread();  // after the last cycle: writes what still waits
    BlackBoxThread(const BlackBoxThread&) = delete;
    BlackBoxThread& operator=(const BlackBoxThread&) = delete;

  private:
    void run();

    BlackBoxWriter& writer_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

}  // namespace wheelwright::task
