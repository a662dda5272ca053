// Digital lines made of software. The input shows what it is told; the output records when it changed.
//
// Threads: one. No call allocates (the recordings are fixed rings), blocks or throws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "hal/clock.hpp"
#include "hal/digital_line.hpp"

namespace wheelwright::sim {

// One change of a line's level.
struct LineChange {
    std::int64_t time_ns = 0;
    hal::LineLevel level = hal::LineLevel::unknown;
};

// The latest changes of a line, oldest first. Beyond `capacity` the oldest are forgotten, but still counted.
class LineHistory {
  public:
    static constexpr std::size_t capacity = 64;

    std::size_t size() const { return total_ < capacity ? total_ : capacity; }
    std::size_t total() const { return total_; }

    // index 0 is the oldest remembered change; index < size().
    const LineChange& operator[](std::size_t index) const {
        return changes_[(total_ - size() + index) % capacity];
    }

    void add(std::int64_t time_ns, hal::LineLevel level) {
        changes_[total_ % capacity] = LineChange{time_ns, level};
        ++total_;
    }

  private:
    std::array<LineChange, capacity> changes_{};
    std::size_t total_ = 0;
};

class SimInput final : public hal::DigitalInput {
  public:
    explicit SimInput(const hal::Clock& clock, hal::LineLevel level = hal::LineLevel::inactive)
        : clock_(&clock), level_(level) {}

    hal::LineLevel read() override { return level_; }

    // What the wire does from now on. `unknown` is a line that cannot be read.
    void set(hal::LineLevel level) {
        if (level != level_) {
            level_ = level;
            history_.add(clock_->now_ns(), level);
        }
    }

    const LineHistory& history() const { return history_; }

  private:
    const hal::Clock* clock_;
    hal::LineLevel level_;
    LineHistory history_;
};

class SimOutput final : public hal::DigitalOutput {
  public:
    explicit SimOutput(const hal::Clock& clock) : clock_(&clock) {}

    bool write(bool active) override {
        if (broken_) {
            return false;
        }
        const hal::LineLevel level = active ? hal::LineLevel::active : hal::LineLevel::inactive;
        if (level != level_) {
            level_ = level;
            history_.add(clock_->now_ns(), level);
        }
        return true;
    }

    // The level on the wire; `unknown` before the first write.
    hal::LineLevel level() const { return level_; }

    // A broken line refuses writes and keeps its level.
    void set_broken(bool broken) { broken_ = broken; }

    const LineHistory& history() const { return history_; }

  private:
    const hal::Clock* clock_;
    hal::LineLevel level_ = hal::LineLevel::unknown;
    bool broken_ = false;
    LineHistory history_;
};

}  // namespace wheelwright::sim
