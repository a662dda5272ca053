// Time that moves only when told: the clock under a simulated world.
//
// Threads: one. No call allocates, blocks or throws.
#pragma once

#include <cstdint>

#include "hal/clock.hpp"

namespace wheelwright::sim {

class VirtualClock final : public hal::Clock {
  public:
    // What happens while somebody sleeps on this clock. A simulated world implements it.
    class Sleeper {
      public:
        virtual ~Sleeper() = default;

        // Called with `deadline_ns` in the future. Lets the world run up to the deadline, moving the clock
        // with advance_to() from event to event. The clock itself goes the rest of the way afterwards.
        virtual void run_until(std::int64_t deadline_ns) = 0;
    };

    explicit VirtualClock(std::int64_t start_ns = 0) : now_ns_(start_ns) {}

    std::int64_t now_ns() const override { return now_ns_; }

    // Moves time forward. A time that has passed already leaves the clock where it is: it never goes back.
    void advance_to(std::int64_t time_ns) {
        if (time_ns > now_ns_) {
            now_ns_ = time_ns;
        }
    }

    // Lets the sleeper, if there is one, run the world; then stands exactly at `deadline_ns`, or later when
    // the sleeper went further. A deadline that has passed returns at once and runs nothing.
    void sleep_until_ns(std::int64_t deadline_ns) override {
        if (deadline_ns <= now_ns_) {
            return;
        }
        if (sleeper_ != nullptr) {
            sleeper_->run_until(deadline_ns);
        }
        advance_to(deadline_ns);
    }

    // Not owned; null removes it. It must outlive its use.
    void set_sleeper(Sleeper* sleeper) { sleeper_ = sleeper; }

  private:
    std::int64_t now_ns_;
    Sleeper* sleeper_ = nullptr;
};

}  // namespace wheelwright::sim
