// An enable line does not outlive the process that holds it.
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <ctime>
#include <memory>

#include "hal/linux/line_guard.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

// A wire that every process sees.
class SharedWire final : public hal::DigitalOutput {
  public:
    explicit SharedWire(std::atomic<bool>& level) : level_(level) {}
    bool write(bool active) override {
        level_ = active;
        return true;
    }

  private:
    std::atomic<bool>& level_;
};

bool soon(const std::atomic<bool>& level, bool wanted) {
    for (int ms = 0; ms < 20000; ++ms) {
        if (level == wanted) return true;
        const timespec one_ms{0, 1'000'000};
        nanosleep(&one_ms, nullptr);
    }
    return false;
}

}  // namespace

TEST_GROUP(LineGuard) {
    static constexpr std::size_t kBytes = 2 * sizeof(std::atomic<bool>);
    void* memory_ = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    std::atomic<bool>& level_ = *std::construct_at(static_cast<std::atomic<bool>*>(memory_), false);
    std::atomic<bool>& may_end_ = *std::construct_at(&level_ + 1, false);

    void teardown() override { munmap(memory_, kBytes); }

    // A firmware that enables its drives and then does as `end` says.
    template <typename End>
    void firmware_that(End end) {
        const pid_t firmware = fork();
        if (firmware == 0) {
            setpgid(0, 0);
            SharedWire wire(level_);
            if (!hal::guard_line(wire, 1)) _exit(1);
            wire.write(true);
            end();
            for (;;) pause();
        }
        CHECK_TRUE(soon(level_, true));
        firmware_ = firmware;
    }
    pid_t firmware_ = 0;
};

TEST(LineGuard, a_killed_process_takes_its_line_with_it) {
    firmware_that([] {});
    kill(firmware_, SIGKILL);
    CHECK_TRUE(soon(level_, false));
    waitpid(firmware_, nullptr, 0);
}

TEST(LineGuard, so_does_one_whose_group_is_told_to_end_and_one_that_ends) {
    for (const int signal : {SIGTERM, SIGINT, SIGABRT}) {
        firmware_that([] {});
        kill(-firmware_, signal);
        CHECK_TRUE(soon(level_, false));
        waitpid(firmware_, nullptr, 0);
    }
    firmware_that([this] {
        soon(may_end_, true);
        _exit(0);
    });
    may_end_ = true;
    CHECK_TRUE(soon(level_, false));
    waitpid(firmware_, nullptr, 0);
}

TEST(LineGuard, lets_the_line_be_while_the_process_lives) {
    firmware_that([] {});
    const timespec a_while{0, 50'000'000};
    nanosleep(&a_while, nullptr);
    CHECK_TRUE(level_);
    kill(firmware_, SIGKILL);
    waitpid(firmware_, nullptr, 0);
}
