// When cycles are due, how late they woke, how long they took, which were missed. Arithmetic only: the loop
// that sleeps is realtime_loop.hpp, and the same schedule runs under the virtual clock.
//
// A cycle is missed when its whole period passes before it can start. Missed cycles are counted and skipped;
// they are never made up by running twice, and the grid of deadlines does not move.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace wheelwright::task {

inline constexpr std::int64_t kCyclePeriod_ns = 1'000'000;  // 1 kHz
inline constexpr double kCyclePeriod_s = 1e-3;

// What one cycle is told about time.
struct CycleTime {
    std::int64_t scheduled_ns = 0;       // the deadline on the grid: the cycle's "now"
    std::int64_t woken_ns = 0;           // when it really began
    std::int64_t last_execution_ns = 0;  // how long the cycle before this one computed, sends included
    std::int64_t missed = 0;             // cycles skipped since the cycle before this one

    // From the deadline that was slept for, so with the periods that were missed because of it.
    std::int64_t wake_latency_ns() const { return woken_ns - scheduled_ns + missed * kCyclePeriod_ns; }
};

class CycleSchedule {
  public:
    explicit CycleSchedule(std::int64_t first_deadline_ns) : deadline_ns_(first_deadline_ns) {}

    std::int64_t next_deadline_ns() const { return deadline_ns_; }

    // Call when woken for the next deadline.
    CycleTime begin(std::int64_t now_ns) {
        std::int64_t missed = (now_ns - deadline_ns_) / kCyclePeriod_ns;
        if (missed < 0) missed = 0;
        deadline_ns_ += missed * kCyclePeriod_ns;
        const CycleTime time{deadline_ns_, now_ns, last_execution_ns_, missed};
        deadline_ns_ += kCyclePeriod_ns;
        return time;
    }

    // Call when the cycle's work is done; `computing_ns` leaves out the wait for the sending phase.
    void end(std::int64_t computing_ns) { last_execution_ns_ = computing_ns; }

  private:
    std::int64_t deadline_ns_;
    std::int64_t last_execution_ns_ = 0;
};

// Says when missed cycles become a fault: so many in a row, or so many within the last second.
class OverrunMonitor {
  public:
    OverrunMonitor(std::int32_t in_a_row, std::int32_t per_second)
        : in_a_row_(in_a_row), per_second_(per_second) {}

    // One cycle that ran, with the number missed before it. True: a fault.
    bool step(std::int64_t missed) {
        total_ += static_cast<std::uint64_t>(missed);
        // One slot for each period of the last second, missed or run.
        for (std::int64_t i = 0; i < missed && i < std::int64_t(kSlots); ++i) put(true);
        put(false);
        return missed >= in_a_row_ || recent_ >= per_second_;
    }

    std::uint64_t total() const { return total_; }

  private:
    static constexpr std::size_t kSlots = 1000;

    void put(bool missed) {
        recent_ += int(missed) - int(was_missed_[next_]);
        was_missed_[next_] = missed;
        next_ = next_ + 1 == kSlots ? 0 : next_ + 1;
    }

    std::int64_t in_a_row_;
    std::int64_t per_second_;
    std::array<bool, kSlots> was_missed_{};
    std::size_t next_ = 0;
    std::int64_t recent_ = 0;
    std::uint64_t total_ = 0;
};

// Counts of a duration in bins of fixed width; the last bin holds everything longer. No allocation.
class DurationHistogram {
  public:
    static constexpr std::size_t kBins = 1024;
    static constexpr std::int64_t kBin_ns = 1000;

    void add(std::int64_t duration_ns) {
        if (duration_ns < 0) duration_ns = 0;
        if (duration_ns > largest_ns_) largest_ns_ = duration_ns;
        auto bin = static_cast<std::size_t>(duration_ns / kBin_ns);
        if (bin >= kBins) bin = kBins - 1;
        ++count_[bin];
        ++total_;
    }

    // Upper edge of the bin within which `share` (0..1] of all durations lie; 0 when there are none.
    std::int64_t quantile_ns(double share) const {
        const auto wanted = static_cast<std::uint64_t>(share * static_cast<double>(total_));
        std::uint64_t sum = 0;
        for (std::size_t i = 0; i < kBins; ++i) {
            sum += count_[i];
            if (sum >= wanted && sum > 0) {
                const std::int64_t edge = static_cast<std::int64_t>(i + 1) * kBin_ns;
                return i + 1 == kBins || edge > largest_ns_ ? largest_ns_ : edge;
            }
        }
        return largest_ns_;
    }

    std::uint64_t total() const { return total_; }
    std::int64_t largest_ns() const { return largest_ns_; }
    std::uint64_t count(std::size_t bin) const { return count_[bin]; }

  private:
    std::array<std::uint64_t, kBins> count_{};
    std::uint64_t total_ = 0;
    std::int64_t largest_ns_ = 0;
};

}  // namespace wheelwright::task
