// Writes saved parameters to the robot file, on a thread that may wait for a disk, far from the cycle's.
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "firmware/task/parameter_service.hpp"

namespace wheelwright::task {

class Saver {
  public:
    // `mailbox` outlives the saver. Start it after the process's signal mask is set: the thread inherits it.
    Saver(std::string path, SaveMailbox& mailbox);
    ~Saver();  // waits for a save under way
    Saver(const Saver&) = delete;
    Saver& operator=(const Saver&) = delete;

  private:
    void run();

    std::string path_;
    SaveMailbox& mailbox_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

}  // namespace wheelwright::task
