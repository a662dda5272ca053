#include "firmware/task/black_box.hpp"

#include <algorithm>
#include <cstring>

namespace wheelwright::task {
namespace {

// One cycle at its worst: 64 FD frames from each of two buses, and all that it sends.
constexpr std::size_t kMostOfACycle_bytes = 16'384;

// A copy that may be torn, and is then thrown away. The thread sanitizer would call that a race.
__attribute__((no_sanitize("thread"), noinline)) void copy_while_it_may_change(
    std::byte* to, std::span<const std::byte> from) {
    using Word [[gnu::may_alias]] = std::uint64_t;
    std::size_t i = 0;
    if (reinterpret_cast<std::uintptr_t>(from.data()) % sizeof(Word) == 0) {
        for (; i + sizeof(Word) <= from.size(); i += sizeof(Word)) {
            const Word word = *reinterpret_cast<const volatile Word*>(from.data() + i);
            std::memcpy(to + i, &word, sizeof(word));
        }
    }
    for (; i < from.size(); ++i) {
        const volatile std::byte& byte = from[i];
        to[i] = byte;
    }
}

}  // namespace

// ---- ports ----------------------------------------------------------------------------------------------

template <std::uint8_t kNumber>
hal::CanStatus BlackBox::Bus<kNumber>::send(const hal::CanFrame& frame) {
    const hal::CanStatus status = real_.send(frame);
    const RecordKind kind = status == hal::CanStatus::ok ? RecordKind::sent : RecordKind::refused;
    if (box_.runs_) box_.tape_.frame(kind, kNumber, frame, 0);
    return status;
}

template <std::uint8_t kNumber>
bool BlackBox::Bus<kNumber>::waits(std::uint32_t id) const {
    const bool waits = real_.waits(id);
    if (waits && box_.runs_) box_.tape_.waits(kNumber, id);
    return waits;
}

template <std::uint8_t kNumber>
hal::CanStatus BlackBox::Bus<kNumber>::receive(hal::ReceivedFrame& out) {
    const hal::CanStatus status = real_.receive(out);
    if (!box_.runs_) return status;
    if (status == hal::CanStatus::ok) {
        box_.tape_.frame(RecordKind::received, kNumber, out.frame, out.timestamp_ns);
    } else if (status == hal::CanStatus::bus_down) {
        box_.record_.inputs.bus_down[kNumber] = true;
    }
    return status;
}

template <std::uint8_t kNumber>
hal::CanStatistics BlackBox::Bus<kNumber>::statistics() const {
    const hal::CanStatistics now = real_.statistics();
    const BoxStatistics told{now.receive_overflow, now.error_frames, now.bus_off};
    if (box_.runs_ && kNumber == 0 && told != box_.statistics_) {
        box_.statistics_ = told;
        box_.tape_.statistics(told);
    }
    return now;
}

hal::LineLevel BlackBox::StopLine::read() {
    const hal::LineLevel level = real_.read();
    if (box_.runs_) box_.record_.inputs.stop_line = level;
    return level;
}

bool BlackBox::EnableLine::write(bool active) {
    const bool written = real_.write(active);
    if (box_.runs_) box_.record_.inputs.enable_written = written;
    return written;
}

// ---- recording ------------------------------------------------------------------------------------------

BlackBox::BlackBox(const CyclePorts& real, SaveMailbox& mailbox)
    : drive_bus_(*this, real.drive_bus), real_(real), mailbox_(mailbox) {
    if (real.host_bus != nullptr) host_bus_.emplace(*this, *real.host_bus);
    if (real.emergency_stop != nullptr) stop_line_.emplace(*this, *real.emergency_stop);
    if (real.drive_enable != nullptr) enable_line_.emplace(*this, *real.drive_enable);
}

BlackBox::~BlackBox() = default;

CyclePorts BlackBox::ports() {
    return {drive_bus_,      host_bus_ ? &*host_bus_ : nullptr,   real_.left,
            real_.right,     stop_line_ ? &*stop_line_ : nullptr, enable_line_ ? &*enable_line_ : nullptr,
            real_.arming_key};
}

void BlackBox::watch(Cycle& cycle) {
    cycle_ = &cycle;
    memory_bytes_ = sizeof(statistics_);
    for (const auto& part : cycle.memory()) memory_bytes_ += part.size();
    for (Segment& segment : segments_) {
        // Written to, so that no page is missing when the loop comes to it.
        segment.records = std::make_unique<std::byte[]>(kSegment_bytes);
        segment.memory = std::make_unique<std::byte[]>(memory_bytes_);
    }
    begin_segment();
    snapshot();
}

void BlackBox::begin(const CycleTime& time) {
    if (tape_.position() > full_ ||
        number_ + 1 == segments_[order_[count_ - 1]].first_cycle + kSegmentCycles) {
        begin_segment();
    }
    ++number_;
    sequence_.store(2 * number_ - 1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    record_ = {time, 0, {}, {}};
    tape_.cycle(time);
    runs_ = true;
}

void BlackBox::end() {
    record_.inputs.terminate = cycle_->conditions().terminate;
    record_.inputs.save = mailbox_.answers();
    record_.state = CycleState::of(cycle_->supervisor());
    tape_.end(record_);
    runs_ = false;
    sequence_.store(2 * number_, std::memory_order_release);

    const protocol::Fault fault = cycle_->supervisor().fault();
    if (fault != fault_) {
        fault_ = fault;
        if (fault != protocol::Fault::none) note_fault();
    }
    if (fault_cycle_ != 0 && number_ - fault_cycle_ >= kCyclesAfterFault) hand_over();
}

void BlackBox::note_fault() {
    if (fault_cycle_ != 0) {
        ++further_faults_;
        return;
    }
    fault_cycle_ = number_;
    waiting_fault_ = fault_;
    further_faults_ = 0;
}

std::size_t BlackBox::free_segment() const {
    for (std::size_t i = 0; i < kSegments; ++i) {
        const auto end = order_.begin() + static_cast<std::ptrdiff_t>(count_);
        if (!segments_[i].handed.load(std::memory_order_acquire) && std::find(order_.begin(), end, i) == end)
            return i;
    }
    return kSegments;
}

void BlackBox::begin_segment() {
    if (count_ > 0) close_segment();
    std::size_t next = count_ < kRecordSegments ? free_segment() : kSegments;
    if (next == kSegments) {
        next = order_[0];
        std::copy(order_.begin() + 1, order_.end(), order_.begin());
        --count_;
        if (fault_cycle_ != 0 && (count_ == 0 || fault_cycle_ < segments_[order_[0]].first_cycle)) {
            // The fault goes with the oldest segment: its record has waited for too long.
            lost_faults_.fetch_add(1 + further_faults_, std::memory_order_relaxed);
            fault_cycle_ = 0;
        }
    }
    order_[count_++] = next;
    Segment& segment = segments_[next];
    segment.first_cycle = number_ + 1;
    tape_.start(segment.records.get());
    full_ = segment.records.get() + kSegment_bytes - kMostOfACycle_bytes;
    const std::uint64_t count = (newest_.load(std::memory_order_relaxed) >> 4U) + 1;
    static_assert(kSegments <= 16);
    newest_.store(count << 4U | next, std::memory_order_release);
}

void BlackBox::close_segment() {
    Segment& segment = segments_[order_[count_ - 1]];
    segment.used_bytes = static_cast<std::size_t>(tape_.position() - segment.records.get());
}

void BlackBox::hand_over() {
    if (handed_.load(std::memory_order_acquire)) return;  // the one before is still being written
    close_segment();
    written_ = {};
    written_.fault = waiting_fault_;
    written_.fault_cycle = fault_cycle_;
    written_.further_faults = further_faults_;
    written_.segment_count = count_;
    for (std::size_t i = 0; i < count_; ++i) {
        written_.segments[i] = &segments_[order_[i]];
        written_.segments[i]->handed.store(true, std::memory_order_relaxed);
    }
    fault_cycle_ = 0;
    count_ = 0;
    begin_segment();
    handed_.store(true, std::memory_order_release);
}

void BlackBox::flush() {
    if (fault_cycle_ != 0) hand_over();
}

// ---- writing --------------------------------------------------------------------------------------------

bool BlackBox::snapshot() {
    const std::uint64_t newest = newest_.load(std::memory_order_acquire);
    if (newest == copied_) return true;
    const std::uint64_t before = sequence_.load(std::memory_order_acquire);
    if (before % 2 != 0) return false;
    Segment& segment = segments_[newest & 15U];
    segment.memory_cycle = Segment::kNever;
    std::byte* to = segment.memory.get();
    const auto copy = [&to](std::span<const std::byte> from) {
        copy_while_it_may_change(to, from);
        to += from.size();
    };
    for (const auto& part : cycle_->memory()) copy(part);
    copy(std::as_bytes(std::span(&statistics_, 1)));
    std::atomic_thread_fence(std::memory_order_acquire);
    if (sequence_.load(std::memory_order_relaxed) != before) return false;
    segment.memory_cycle = before / 2;
    copied_ = newest;
    return true;
}

}  // namespace wheelwright::task
