#include "firmware/task/black_box_file.hpp"

#include <algorithm>
#include <charconv>
#include <cinttypes>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <istream>
#include <optional>

#include "firmware/task/robot_file.hpp"
#include "hal/linux/candump.hpp"

namespace wheelwright::task {
namespace {

constexpr std::size_t kWidest = 160;  // of a comment that we cut
constexpr std::size_t kMemoryLine_bytes = 64;
constexpr std::size_t kMostMemory_bytes = std::size_t{1} << 20U;
constexpr std::string_view kTitle = "# wheelwright black box 1: `wheelwright replay` runs its cycles again";

class Fnv1a {
  public:
    void add(std::string_view bytes) {
        for (const char c : bytes) value_ = (value_ ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
    }
    std::uint64_t value() const { return value_; }

  private:
    std::uint64_t value_ = 0xcbf29ce484222325U;
};

std::uint64_t hash_of(std::span<const std::byte> bytes) {
    Fnv1a hash;
    hash.add({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    return hash.value();
}

// ---- writing --------------------------------------------------------------------------------------------

[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...) {
    std::array<char, 400> buffer{};
    va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(buffer.data(), buffer.size(), format, arguments);
    va_end(arguments);
    return buffer.data();
}

// Hands lines on in pieces that are worth a write.
class Lines {
  public:
    explicit Lines(const std::function<bool(std::string_view)>& write) : write_(write) {}
    void add(const std::string& line) {
        piece_ += line;
        piece_ += '\n';
        ++count_;
        if (piece_.size() > 65'536) flush();
    }
    bool end() {
        flush();
        add(text("#. %zu %016" PRIx64, count_, hash_.value()));
        flush();
        return good_;
    }
    bool good() const { return good_; }

  private:
    void flush() {
        hash_.add(piece_);
        good_ = good_ && write_(piece_);
        piece_.clear();
    }
    const std::function<bool(std::string_view)>& write_;
    std::string piece_;
    Fnv1a hash_;
    std::size_t count_ = 0;
    bool good_ = true;
};

void add_robot_file(Lines& lines, std::string_view file) {
    while (!file.empty()) {
        const std::size_t end = std::min(file.find('\n'), file.size());
        std::string_view line = file.substr(0, end);
        file.remove_prefix(std::min(end + 1, file.size()));
        const char* mark = "#|";
        do {
            lines.add(std::string(mark) + std::string(line.substr(0, kWidest)));
            line.remove_prefix(std::min(kWidest, line.size()));
            mark = "#+";
        } while (!line.empty());
    }
}

void add_parameters(Lines& lines, const model::RobotParameters& parameters) {
    for (const model::ParameterInfo& info : model::parameter_table()) {
        const double value = info.get(parameters);
        const bool named = info.kind == model::ParameterKind::choice && value >= 0 &&
                           value < static_cast<double>(info.choices.size());
        lines.add(
            "#*" + std::string(info.key) + " = " +
            (named ? std::string(info.choices[static_cast<std::size_t>(value)]) : shortest_number(value)) +
            (info.unit.empty() ? "" : " " + std::string(info.unit)));
    }
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!parameters.effects.active[i]) continue;
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j) {
            lines.add("#*" + std::string(model::kEffects[i].name) + "." +
                      std::string(model::kEffects[i].parameters[j].name) + " = " +
                      shortest_number(parameters.effects.parameter[i][j]));
        }
    }
}

void add_memory(Lines& lines, std::span<const std::byte> memory) {
    constexpr std::string_view kDigits = "0123456789ABCDEF";
    for (std::size_t i = 0; i < memory.size(); i += kMemoryLine_bytes) {
        std::string line = "#=";
        for (const std::byte byte : memory.subspan(i, std::min(kMemoryLine_bytes, memory.size() - i))) {
            line += kDigits[std::to_integer<unsigned>(byte) >> 4U];
            line += kDigits[std::to_integer<unsigned>(byte) & 15U];
        }
        lines.add(line);
    }
}

template <typename T>
T read_as(const std::byte* at) {
    T record;
    std::memcpy(&record, at, sizeof(T));
    return record;
}

std::string cycle_line(std::uint64_t number, const BoxCycle& cycle) {
    const CycleRecord& r = cycle.told;
    const CycleInputs& in = r.inputs;
    const CycleState& s = r.state;
    return text("#> %" PRIu64 " %zu %" PRId64 " %" PRId64 " %" PRId64 " %" PRId64 " %" PRId64
                " %u %u %u %u %u %u %u %u %u %u %u %u %u",
                number, cycle.frames.size() + cycle.statistics.size(), r.time.scheduled_ns,
                r.time.woken_ns - r.time.scheduled_ns, r.time.last_execution_ns, r.time.missed,
                r.sending_ns - r.time.scheduled_ns, unsigned(in.stop_line), unsigned(in.enable_written),
                unsigned(in.bus_down[0]), unsigned(in.bus_down[1]), unsigned(in.terminate),
                unsigned(in.save.refused), unsigned(in.save.outcome), unsigned(s.mode), unsigned(s.requested),
                unsigned(s.phase), unsigned(s.owner), unsigned(s.fault), unsigned(s.blocker));
}

std::string frame_line(const std::string& place, const BoxFrame& frame, std::int64_t time_ns,
                       const BoxAbout& about) {
    if (frame.kind == RecordKind::waits)
        return "#w " + place + text(" %u %03X", unsigned(frame.bus), frame.received.frame.id);
    const bool received = frame.kind == RecordKind::received;
    hal::LogFrame line;
    line.time_ns = time_ns + about.offset_ns;
    line.interface = about.interface[frame.bus];
    line.frame = frame.received.frame;
    line.suffix = (received ? " R " : " T ") + place;
    if (received) line.suffix += text(" %03d", int(time_ns % 1000));
    return (frame.kind == RecordKind::refused ? "#! " : "") + hal::format_candump_line(line);
}

// Puts lines into the order of their times, which differs from that of the cycles by one of them.
class Sorted {
  public:
    explicit Sorted(Lines& lines) : lines_(lines) {}
    void add(std::int64_t time_ns, std::string line) { waiting_.push_back({time_ns, std::move(line)}); }
    // Nothing from before this time will come, but what has waited for long.
    void until(std::int64_t time_ns) {
        std::stable_sort(waiting_.begin(), waiting_.end(),
                         [](const Line& a, const Line& b) { return a.time_ns < b.time_ns; });
        const auto end = std::find_if(waiting_.begin(), waiting_.end(),
                                      [&](const Line& line) { return line.time_ns >= time_ns; });
        for (auto line = waiting_.begin(); line != end; ++line) lines_.add(line->text);
        waiting_.erase(waiting_.begin(), end);
    }

  private:
    struct Line {
        std::int64_t time_ns;
        std::string text;
    };
    Lines& lines_;
    std::vector<Line> waiting_;
};

void add_cycle(Sorted& sorted, std::uint64_t number, const BoxCycle& cycle, const BoxAbout& about) {
    std::size_t place = 0;
    const auto next_place = [&] { return text("%" PRIu64 ".%zu", number, place++); };
    sorted.add(cycle.told.time.scheduled_ns, cycle_line(number, cycle));
    for (const BoxFrame& frame : cycle.frames) {
        const std::int64_t time_ns =
            frame.kind == RecordKind::received ? frame.received.timestamp_ns : cycle.told.sending_ns;
        sorted.add(time_ns, frame_line(next_place(), frame, time_ns, about));
    }
    for (const BoxStatistics& s : cycle.statistics) {
        sorted.add(cycle.told.sending_ns, "#s " + next_place() +
                                              text(" %" PRIu64 " %" PRIu64 " %" PRIu64, s.receive_overflow,
                                                   s.error_frames, s.bus_off));
    }
}

}  // namespace

bool write_black_box(const BlackBox::Record& record, std::size_t memory_bytes, const BoxAbout& about,
                     const std::function<bool(std::string_view)>& write,
                     const std::function<void(std::size_t)>& read) {
    Lines lines(write);
    lines.add(std::string(kTitle));
    lines.add("#: build " + about.build);
    lines.add("#: fault " + std::string(protocol::to_string_view(record.fault)) +
              text(" %" PRIu64 " %u", record.fault_cycle, record.further_faults));
    lines.add("#: interface " + about.interface[0] +
              (about.interface[1].empty() ? "" : " " + about.interface[1]));
    lines.add(text("#: wiring %d %d %d", int(about.drive_generation), int(about.stop_line),
                   int(about.enable_line)));
    lines.add(text("#: offset_ns %" PRId64, about.offset_ns));
    lines.add(text("#: first_cycle %" PRIu64, record.segments[0]->first_cycle));
    for (std::size_t i = 0; i < record.segment_count; ++i) {
        const BlackBox::Segment& segment = *record.segments[i];
        if (!segment.has_memory()) continue;
        const std::span<const std::byte> memory(segment.memory.get(), memory_bytes);
        lines.add(text("#: memory %" PRIu64 " %zu %016" PRIx64, segment.memory_cycle, memory_bytes,
                       hash_of(memory)));
        add_robot_file(lines, about.robot_file);
        add_parameters(lines,
                       read_as<model::RobotParameters>(memory.data()));  // the first of Cycle::memory()
        add_memory(lines, memory);
        break;
    }
    Sorted sorted(lines);
    BoxCycle cycle;
    for (std::size_t i = 0; i < record.segment_count; ++i) {
        TapeReader tape(record.segments[i]->tape());
        for (std::uint64_t number = record.segments[i]->first_cycle; tape.next(cycle); ++number) {
            add_cycle(sorted, number, cycle, about);
            sorted.until(cycle.told.time.scheduled_ns);
            if (!lines.good()) return false;
        }
        read(i);
    }
    sorted.until(INT64_MAX);
    return lines.end();
}

// ---- reading --------------------------------------------------------------------------------------------
namespace {

// A line's words, as numbers of a kind.
class Words {
  public:
    explicit Words(std::string_view line) : rest_(line) {}
    std::string_view word() {
        const std::size_t begin = std::min(rest_.find_first_not_of(' '), rest_.size());
        rest_.remove_prefix(begin);
        const std::size_t end = std::min(rest_.find(' '), rest_.size());
        const std::string_view found = rest_.substr(0, end);
        rest_.remove_prefix(end);
        return found;
    }
    template <typename T>
    T number(int base = 10) {
        T value{};
        parse(word(), value, base);
        return value;
    }
    // An enumeration or a truth value, up to `last`.
    template <typename T>
    T choice(T last) {
        const auto value = number<unsigned>();
        good_ = good_ && value <= static_cast<unsigned>(last);
        return good_ ? static_cast<T>(value) : T{};
    }
    // "cycle.place"
    void place(std::uint64_t& cycle, std::uint32_t& place) {
        const std::string_view found = word();
        const std::size_t point = found.find('.');
        if (point == std::string_view::npos) {
            good_ = false;
            return;
        }
        parse(found.substr(0, point), cycle, 10);
        parse(found.substr(point + 1), place, 10);
    }
    std::string rest() {
        const std::size_t begin = std::min(rest_.find_first_not_of(' '), rest_.size());
        return std::string(rest_.substr(begin));
    }
    bool good() const { return good_; }
    bool all() const { return good_ && rest_.find_first_not_of(' ') == std::string_view::npos; }

  private:
    template <typename T>
    void parse(std::string_view word, T& value, int base) {
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value, base);
        good_ = good_ && error == std::errc{} && end == word.data() + word.size();
    }
    std::string_view rest_;
    bool good_ = true;
};

class Reader {
  public:
    explicit Reader(BlackBoxFile& out) : out_(out) {}
    // "" or what is wrong.
    std::string take(const std::string& line);
    std::string finish();

  private:
    struct Placed {
        std::uint64_t cycle = 0;
        std::uint32_t place = 0;
        std::optional<BoxStatistics> statistics;
        BoxFrame frame;
    };
    std::string take_key(std::string_view line);
    std::string take_memory(std::string_view digits);
    std::string take_cycle(std::string_view line);
    std::string take_frame(std::string_view line, bool refused);
    std::string take_waits(std::string_view line);
    std::string take_statistics(std::string_view line);

    BlackBoxFile& out_;
    std::vector<Placed> placed_;
    std::vector<std::uint32_t> counts_;  // of each cycle's lines
    std::size_t memory_bytes_ = 0;
    std::uint64_t memory_hash_ = 0;
};

std::string Reader::take(const std::string& line) {
    if (line.starts_with('(')) return take_frame(line, false);
    const std::string_view rest = std::string_view(line).substr(std::min<std::size_t>(2, line.size()));
    if (line.starts_with("#>")) return take_cycle(rest);
    if (line.starts_with("#!")) return take_frame(rest.substr(std::min<std::size_t>(1, rest.size())), true);
    if (line.starts_with("#w")) return take_waits(rest);
    if (line.starts_with("#s")) return take_statistics(rest);
    if (line.starts_with("#=")) return take_memory(rest);
    if (line.starts_with("#:")) return take_key(rest);
    if (line.starts_with("#|") || line.starts_with("#+")) {
        if (line[1] == '|' && !out_.about.robot_file.empty()) out_.about.robot_file += '\n';
        out_.about.robot_file += rest;
        return "";
    }
    return line.starts_with('#') ? "" : "is no line of a black box";
}

std::string Reader::take_key(std::string_view line) {
    Words words(line);
    const std::string_view key = words.word();
    BoxAbout& about = out_.about;
    if (key == "build") {
        about.build = words.rest();
        return "";
    }
    if (key == "fault") {
        out_.fault = words.word();
        out_.fault_cycle = words.number<std::uint64_t>();
    } else if (key == "interface") {
        about.interface = {std::string(words.word()), std::string(words.word())};
    } else if (key == "wiring") {
        about.drive_generation = words.number<std::int32_t>();
        about.stop_line = words.choice(true);
        about.enable_line = words.choice(true);
    } else if (key == "offset_ns") {
        about.offset_ns = words.number<std::int64_t>();
    } else if (key == "first_cycle") {
        out_.first_cycle = words.number<std::uint64_t>();
    } else if (key == "memory") {
        out_.memory_cycle = words.number<std::uint64_t>();
        memory_bytes_ = words.number<std::size_t>();
        memory_hash_ = words.number<std::uint64_t>(16);
        if (memory_bytes_ > kMostMemory_bytes) return "a memory so large is nobody's";
    }
    return words.good() ? "" : "cannot be understood";
}

std::string Reader::take_memory(std::string_view digits) {
    if (digits.size() % 2 != 0 || out_.memory.size() + digits.size() / 2 > memory_bytes_)
        return "more memory than was announced";
    for (std::size_t i = 0; i < digits.size(); i += 2) {
        unsigned value = 0;
        const char* const end = digits.data() + i + 2;
        const auto parsed = std::from_chars(digits.data() + i, end, value, 16);
        if (parsed.ec != std::errc{} || parsed.ptr != end) return "memory is not hexadecimal";
        out_.memory.push_back(static_cast<std::byte>(value));
    }
    return "";
}

std::string Reader::take_cycle(std::string_view line) {
    Words w(line);
    BoxCycle cycle;
    CycleRecord& r = cycle.told;
    const auto number = w.number<std::uint64_t>();
    const auto count = w.number<std::uint32_t>();
    r.time.scheduled_ns = w.number<std::int64_t>();
    const auto woken = w.number<std::int64_t>();
    r.time.last_execution_ns = w.number<std::int64_t>();
    r.time.missed = w.number<std::int64_t>();
    const auto sending = w.number<std::int64_t>();
    CycleInputs& in = r.inputs;
    in.stop_line = w.choice(hal::LineLevel::unknown);
    in.enable_written = w.choice(true);
    in.bus_down = {w.choice(true), w.choice(true)};
    in.terminate = w.choice(true);
    in.save.refused = w.choice(true);
    in.save.outcome = w.choice(SaveMailbox::Outcome::failed);
    CycleState& s = r.state;
    s.mode = static_cast<protocol::Mode>(w.number<std::uint8_t>());
    s.requested = static_cast<protocol::Mode>(w.number<std::uint8_t>());
    s.phase = static_cast<supervisor::Phase>(w.number<std::uint8_t>());
    s.owner = static_cast<supervisor::Owner>(w.number<std::uint8_t>());
    s.fault = static_cast<protocol::Fault>(w.number<std::uint8_t>());
    s.blocker = static_cast<protocol::Blocker>(w.number<std::uint8_t>());
    if (!w.all()) return "cannot be understood";
    constexpr std::int64_t kLongest_ns = std::int64_t{1} << 60U;  // sums of two are numbers still
    for (const std::int64_t time :
         {r.time.scheduled_ns, woken, r.time.last_execution_ns, sending, r.time.missed}) {
        if (time < -kLongest_ns || time > kLongest_ns) return "a time is too large";
    }
    r.time.woken_ns = r.time.scheduled_ns + woken;
    r.sending_ns = r.time.scheduled_ns + sending;
    if (number != out_.first_cycle + out_.cycles.size())
        return text("cycle %" PRIu64 " is missing", out_.first_cycle + out_.cycles.size());
    out_.cycles.push_back(std::move(cycle));
    counts_.push_back(count);
    return "";
}

std::string Reader::take_frame(std::string_view line, bool refused) {
    hal::LogFrame read;
    if (std::string wrong = hal::parse_candump_line(line, read); !wrong.empty()) return wrong;
    Placed placed;
    Words words(read.suffix);
    const std::string_view way = words.word();
    words.place(placed.cycle, placed.place);
    placed.frame.received.frame = read.frame;
    placed.frame.bus = read.interface == out_.about.interface[0] ? 0 : 1;
    if (placed.frame.bus == 1 && read.interface != out_.about.interface[1]) return "an interface of nobody's";
    if (way == "R") {
        placed.frame.kind = RecordKind::received;
        placed.frame.received.timestamp_ns =
            read.time_ns - out_.about.offset_ns + words.number<std::uint16_t>();
    } else if (way == "T") {
        placed.frame.kind = refused ? RecordKind::refused : RecordKind::sent;
    } else {
        return "neither received nor sent";
    }
    if (!words.all()) return "has no place in a cycle";
    placed_.push_back(std::move(placed));
    return "";
}

std::string Reader::take_waits(std::string_view line) {
    Words words(line);
    Placed placed;
    words.place(placed.cycle, placed.place);
    placed.frame.kind = RecordKind::waits;
    placed.frame.bus = words.choice(std::uint8_t{1});
    placed.frame.received.frame.id = words.number<std::uint32_t>(16);
    if (!words.all()) return "cannot be understood";
    placed_.push_back(std::move(placed));
    return "";
}

std::string Reader::take_statistics(std::string_view line) {
    Words words(line);
    Placed placed;
    words.place(placed.cycle, placed.place);
    BoxStatistics& s = placed.statistics.emplace();
    s.receive_overflow = words.number<std::uint64_t>();
    s.error_frames = words.number<std::uint64_t>();
    s.bus_off = words.number<std::uint64_t>();
    if (!words.all()) return "cannot be understood";
    placed_.push_back(std::move(placed));
    return "";
}

std::string Reader::finish() {
    if (out_.memory.size() != memory_bytes_ || memory_bytes_ == 0)
        return "the memory is missing, or not whole";
    if (hash_of(out_.memory) != memory_hash_) return "the memory has been changed";
    std::stable_sort(placed_.begin(), placed_.end(), [](const Placed& a, const Placed& b) {
        return a.cycle != b.cycle ? a.cycle < b.cycle : a.place < b.place;
    });
    std::size_t next = 0;
    for (std::size_t i = 0; i < out_.cycles.size(); ++i) {
        const std::uint64_t number = out_.first_cycle + i;
        for (std::uint32_t place = 0; place < counts_[i]; ++place, ++next) {
            if (next == placed_.size() || placed_[next].cycle != number || placed_[next].place != place)
                return text("line %" PRIu64 ".%u is missing", number, place);
            if (placed_[next].statistics) {
                out_.cycles[i].statistics.push_back(*placed_[next].statistics);
            } else {
                out_.cycles[i].frames.push_back(placed_[next].frame);
            }
        }
    }
    if (next != placed_.size())
        return text("line %" PRIu64 ".%u belongs to no cycle", placed_[next].cycle, placed_[next].place);
    const std::uint64_t end = out_.first_cycle + out_.cycles.size();
    if (out_.memory_cycle + 1 < out_.first_cycle || out_.memory_cycle + 1 >= end)
        return "no cycle follows the memory";
    return "";
}

}  // namespace

std::string read_black_box(std::istream& in, BlackBoxFile& out) {
    out = {};
    std::string line;
    if (!std::getline(in, line) || line != kTitle) return "is no black box: its first line is another";
    Reader reader(out);
    Fnv1a hash;
    std::size_t count = 1;
    bool ended = false;
    hash.add(line + '\n');
    while (!ended && std::getline(in, line)) {
        if (line.starts_with("#.")) {
            Words words(std::string_view(line).substr(2));
            const bool whole = words.number<std::size_t>() == count;
            out.as_written = words.number<std::uint64_t>(16) == hash.value() && whole && words.all();
            ended = true;
            continue;
        }
        ++count;
        hash.add(line + '\n');
        if (const std::string wrong = reader.take(line); !wrong.empty())
            return "line " + std::to_string(count) + ": " + wrong;
    }
    if (!ended) return "ends in the middle";
    return reader.finish();
}

}  // namespace wheelwright::task
