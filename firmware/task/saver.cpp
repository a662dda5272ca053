#include "firmware/task/saver.hpp"

#include <chrono>
#include <cstdio>
#include <utility>
#include <vector>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::task {

Saver::Saver(std::string path, SaveMailbox& mailbox)
    : path_(std::move(path)), mailbox_(mailbox), thread_([this] { run(); }) {}

Saver::~Saver() {
    stop_ = true;
    thread_.join();
}

void Saver::run() {
    for (;;) {
        const bool last = stop_;
        if (const ChangedParameters* snapshot = mailbox_.take()) {
            std::vector<FileChange> changes;
            for (std::size_t i = 0; i < snapshot->count; ++i) {
                const ChangedParameter& item = snapshot->items[i];
                if (auto change = file_change(item.index, item.value)) changes.push_back(*change);
            }
            const std::string problem = save_robot_file(path_, changes);
            if (!problem.empty()) std::fprintf(stderr, "wheelwrightd: %s\n", problem.c_str());
            mailbox_.finished(problem.empty());
        }
        if (last) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
}

}  // namespace wheelwright::task
