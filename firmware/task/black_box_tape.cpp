#include "firmware/task/black_box_tape.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

namespace wheelwright::task {
namespace {

// A tag: kind, bus, and whether what follows is short.
constexpr unsigned kKindMask = 7, kBusBit = 8, kShortBit = 16, kSameBit = 32;
// A time's difference from what is expected takes three bytes, or eight.
constexpr unsigned kShort_bytes = 3, kShort_bits = 8 * kShort_bytes;
// A classic data frame's two bytes: its identifier and its length.
constexpr unsigned kLengthShift = 11, kIdMask = (1U << kLengthShift) - 1;
static_assert(std::endian::native == std::endian::little, "numbers lie with their lowest byte first");

// A classic data frame: all that stands between identifier and data is zero, but for a length up to 8.
bool is_plain(const hal::CanFrame& frame) {
    static_assert(offsetof(hal::CanFrame, length) == 4 && offsetof(hal::CanFrame, data) == 10);
    constexpr std::uint64_t kBetween = 0x0000'FFFF'FFFF'FFFF;
    std::uint64_t head = 0;
    std::memcpy(&head, reinterpret_cast<const std::byte*>(&frame) + offsetof(hal::CanFrame, length),
                sizeof(head));
    return (head & kBetween) <= 8 && frame.id <= kIdMask;
}

constexpr bool is_short(std::int64_t value) { return static_cast<std::uint64_t>(value) >> kShort_bits == 0; }

constexpr std::size_t data_bytes(const hal::CanFrame& frame) {
    return std::min<std::size_t>(frame.length, sizeof(frame.data));
}

}  // namespace

// The first `count` of eight bytes; the next ones are written over the rest.
void TapeWriter::put(std::uint64_t bytes, std::size_t count) {
    std::memcpy(next_, &bytes, sizeof(bytes));
    next_ += count;
}

void TapeWriter::cycle(const CycleTime& time) {
    const std::int64_t unexpected_ns = time.scheduled_ns - scheduled_ns_ - kCyclePeriod_ns;
    const std::int64_t late_ns = time.woken_ns - time.scheduled_ns;
    scheduled_ns_ = time.scheduled_ns;
    if (unexpected_ns == 0 && time.missed == 0 && is_short(late_ns) && is_short(time.last_execution_ns)) {
        constexpr unsigned kTag = static_cast<unsigned>(RecordKind::cycle) | kShortBit;
        put(kTag | static_cast<std::uint64_t>(late_ns) << 8U |
                static_cast<std::uint64_t>(time.last_execution_ns) << (8U + kShort_bits),
            1 + 2 * kShort_bytes);
        return;
    }
    put(static_cast<unsigned>(RecordKind::cycle), 1);
    for (const std::int64_t value : {unexpected_ns, late_ns, time.last_execution_ns, time.missed})
        put(static_cast<std::uint64_t>(value), 8);
}

void TapeWriter::frame(RecordKind kind, std::uint8_t bus, const hal::CanFrame& frame, std::int64_t time_ns) {
    const unsigned tag = static_cast<unsigned>(kind) | (bus != 0 ? kBusBit : 0);
    const std::int64_t waited_ns = scheduled_ns_ - time_ns;
    const bool is_received = kind == RecordKind::received;
    if (is_plain(frame) && (!is_received || is_short(waited_ns))) {
        put(tag | kShortBit | static_cast<std::uint64_t>(frame.id) << 8U |
                static_cast<std::uint64_t>(frame.length) << (8U + kLengthShift) |
                (is_received ? static_cast<std::uint64_t>(waited_ns) << 24U : 0),
            3 + (is_received ? kShort_bytes : 0));
        std::memcpy(next_, frame.data.data(), 8);
        next_ += frame.length;
        return;
    }
    put(tag, 1);
    if (is_received) put(static_cast<std::uint64_t>(waited_ns), 8);
    std::memcpy(next_, &frame, kHead_bytes + data_bytes(frame));
    next_ += kHead_bytes + data_bytes(frame);
}

void TapeWriter::waits(std::uint8_t bus, std::uint32_t id) {
    hal::CanFrame frame;
    frame.id = id;
    frame.data = {};
    this->frame(RecordKind::waits, bus, frame, 0);
}

void TapeWriter::statistics(const BoxStatistics& now) {
    put(static_cast<unsigned>(RecordKind::statistics), 1);
    for (const std::uint64_t count : {now.receive_overflow, now.error_frames, now.bus_off}) put(count, 8);
}

void TapeWriter::end(const CycleRecord& record) {
    std::uint64_t inputs = 0;
    std::uint64_t state = 0;
    std::memcpy(&inputs, &record.inputs, sizeof(record.inputs));
    std::memcpy(&state, &record.state, sizeof(record.state));
    const bool same = inputs == inputs_ && state == state_;
    const std::int64_t phase_ns = record.sending_ns - record.time.scheduled_ns;
    const bool is_brief = is_short(phase_ns);
    put(static_cast<unsigned>(RecordKind::end) | (is_brief ? kShortBit : 0) | (same ? kSameBit : 0), 1);
    put(static_cast<std::uint64_t>(phase_ns), is_brief ? kShort_bytes : 8);
    if (same) return;
    put(inputs, sizeof(record.inputs));
    put(state, sizeof(record.state));
    inputs_ = inputs;
    state_ = state;
}

std::uint64_t TapeReader::number(std::size_t count) {
    std::uint64_t value = 0;
    bytes(&value, count);
    return value;
}

std::int64_t TapeReader::time(bool is_brief) {
    return static_cast<std::int64_t>(number(is_brief ? kShort_bytes : 8));
}

void TapeReader::bytes(void* to, std::size_t count) {
    std::memcpy(to, rest_.data(), count);
    rest_ = rest_.subspan(count);
}

bool TapeReader::next(BoxCycle& cycle) {
    if (rest_.empty()) return false;
    cycle.frames.clear();
    cycle.statistics.clear();
    for (;;) {
        const auto tag = static_cast<unsigned>(number(1));
        const bool is_brief = (tag & kShortBit) != 0;
        const auto kind = static_cast<RecordKind>(tag & kKindMask);
        switch (kind) {
            case RecordKind::cycle: {
                CycleTime& time = cycle.told.time;
                scheduled_ns_ += kCyclePeriod_ns + (is_brief ? 0 : this->time(false));
                time.scheduled_ns = scheduled_ns_;
                time.woken_ns = scheduled_ns_ + this->time(is_brief);
                time.last_execution_ns = this->time(is_brief);
                time.missed = is_brief ? 0 : this->time(false);
                continue;
            }
            case RecordKind::statistics: {
                BoxStatistics& now = cycle.statistics.emplace_back();
                for (std::uint64_t* count : {&now.receive_overflow, &now.error_frames, &now.bus_off})
                    *count = number(8);
                continue;
            }
            case RecordKind::end:
                cycle.told.sending_ns = scheduled_ns_ + time(is_brief);
                if ((tag & kSameBit) == 0) {
                    bytes(&inputs_, sizeof(inputs_));
                    bytes(&state_, sizeof(state_));
                }
                cycle.told.inputs = inputs_;
                cycle.told.state = state_;
                return true;
            default:
                break;
        }
        BoxFrame& read = cycle.frames.emplace_back();
        read.kind = kind;
        read.bus = (tag & kBusBit) != 0 ? 1 : 0;
        hal::CanFrame& frame = read.received.frame;
        frame.data = {};
        const auto head = static_cast<unsigned>(is_brief ? number(2) : 0);
        if (kind == RecordKind::received) read.received.timestamp_ns = scheduled_ns_ - time(is_brief);
        if (is_brief) {
            frame.id = head & kIdMask;
            frame.length = static_cast<std::uint8_t>(head >> kLengthShift);
        } else {
            bytes(&frame, TapeWriter::kHead_bytes);
        }
        bytes(frame.data.data(), data_bytes(frame));
    }
}

}  // namespace wheelwright::task
