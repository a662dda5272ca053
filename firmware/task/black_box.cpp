#include "firmware/task/black_box.hpp"

#include <cstring>
#include <new>

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
    box_.put_frame(status == hal::CanStatus::ok ? RecordKind::sent : RecordKind::refused, kNumber, frame, 0);
    return status;
}

template <std::uint8_t kNumber>
bool BlackBox::Bus<kNumber>::waits(std::uint32_t id) const {
    const bool waits = real_.waits(id);
    if (waits) box_.put_waits(kNumber, id);
    return waits;
}

template <std::uint8_t kNumber>
hal::CanStatus BlackBox::Bus<kNumber>::receive(hal::ReceivedFrame& out) {
    const hal::CanStatus status = real_.receive(out);
    if (status == hal::CanStatus::ok) {
        box_.put_frame(RecordKind::received, kNumber, out.frame, out.timestamp_ns);
    } else if (status == hal::CanStatus::bus_down && box_.record_ != nullptr) {
        box_.record_->inputs.bus_down[kNumber] = true;
    }
    return status;
}

template <std::uint8_t kNumber>
hal::CanStatistics BlackBox::Bus<kNumber>::statistics() const {
    const hal::CanStatistics now = real_.statistics();
    StatisticsRecord& last = box_.statistics_;
    if (box_.record_ != nullptr && kNumber == 0 &&
        (now.receive_overflow != last.receive_overflow || now.error_frames != last.error_frames ||
         now.bus_off != last.bus_off)) {
        last = {{RecordKind::statistics, 0}, now.receive_overflow, now.error_frames, now.bus_off};
        box_.put(last);
    }
    return now;
}

hal::LineLevel BlackBox::StopLine::read() {
    const hal::LineLevel level = real_.read();
    if (box_.record_ != nullptr) box_.record_->inputs.stop_line = level;
    return level;
}

bool BlackBox::EnableLine::write(bool active) {
    const bool written = real_.write(active);
    if (box_.record_ != nullptr) box_.record_->inputs.enable_written = written;
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
    for (Bank& bank : banks_) {
        for (Segment& segment : bank.segments) {
            // Written to, so that no page is missing when the loop comes to it.
            segment.records = std::make_unique<std::byte[]>(kSegment_bytes);
            segment.memory = std::make_unique<std::byte[]>(memory_bytes_);
        }
    }
    begin_segment();
    snapshot();
}

template <typename T>
T& BlackBox::put(const T& record) {
    T* const at = new (next_) T(record);
    next_ += sizeof(T);
    return *at;
}

void BlackBox::put_frame(RecordKind kind, std::uint8_t bus, const hal::CanFrame& frame,
                         std::int64_t time_ns) {
    if (record_ == nullptr) return;
    FrameRecord* const record = new (next_) FrameRecord;
    record->head = {kind, bus};
    std::memcpy(record->frame.data(), &frame, kFrameStart_bytes);
    record->time_ns = time_ns;
    next_ += sizeof(FrameRecord);
    if (frame.length > 8) {
        std::memcpy(next_, frame.data.data() + 8, rest_bytes(frame.length));
        next_ += rest_bytes(frame.length);
    }
}

void BlackBox::put_waits(std::uint8_t bus, std::uint32_t id) {
    hal::CanFrame frame;
    frame.id = id;
    frame.data = {};
    put_frame(RecordKind::waits, bus, frame, 0);
}

void BlackBox::begin(const CycleTime& time) {
    const Bank& bank = banks_[bank_];
    if (next_ > full_ || number_ + 1 == bank.segments[bank.newest].first_cycle + kSegmentCycles) {
        begin_segment();
    }
    ++number_;
    sequence_.store(2 * number_ - 1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    record_ = &put(CycleRecord{{RecordKind::cycle, 0}, time, 0, {}, {}});
}

void BlackBox::end() {
    record_->inputs.terminate = cycle_->conditions().terminate;
    record_->inputs.save = mailbox_.answers();
    record_->state = CycleState::of(cycle_->supervisor());
    record_ = nullptr;
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

void BlackBox::begin_segment() {
    Bank& bank = banks_[bank_];
    if (bank.count > 0) close_segment(bank);
    bank.newest = (bank.newest + 1) % kSegments;
    Segment& segment = bank.segments[bank.newest];
    if (bank.count < kSegments) {
        ++bank.count;
    } else if (fault_cycle_ != 0 && fault_cycle_ < bank.segments[(bank.newest + 1) % kSegments].first_cycle) {
        // The fault goes with the oldest segment: its record has waited for too long.
        lost_faults_.fetch_add(1 + further_faults_, std::memory_order_relaxed);
        fault_cycle_ = 0;
    }
    segment.first_cycle = number_ + 1;
    next_ = segment.records.get();
    full_ = next_ + kSegment_bytes - kMostOfACycle_bytes;
    const std::uint64_t count = (newest_.load(std::memory_order_relaxed) >> 3U) + 1;
    newest_.store(count << 3U | bank_ << 2U | bank.newest, std::memory_order_release);
}

void BlackBox::close_segment(Bank& bank) {
    Segment& segment = bank.segments[bank.newest];
    segment.used_bytes = static_cast<std::size_t>(next_ - segment.records.get());
}

void BlackBox::hand_over() {
    if (handed_.load(std::memory_order_acquire)) return;  // the one before is still being written
    Bank& bank = banks_[bank_];
    close_segment(bank);
    written_ = {};
    written_.fault = waiting_fault_;
    written_.fault_cycle = fault_cycle_;
    written_.further_faults = further_faults_;
    written_.segment_count = bank.count;
    for (std::size_t i = 0; i < bank.count; ++i) {
        written_.segments[i] = &bank.segments[(bank.newest + kSegments + 1 - bank.count + i) % kSegments];
    }
    fault_cycle_ = 0;
    bank_ = 1 - bank_;
    banks_[bank_].count = 0;
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
    Segment& segment = banks_[newest >> 2U & 1U].segments[newest & 3U];
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
