// Runs on a bare Cortex-M7 (or QEMU's mps2-an500): the firmware's cycle in float does again what a host has
// recorded of it in double (recording.hpp), and is compared with it in every cycle. The record is where
// QEMU's loader puts it. Also prints what the cycle needs of the machine: memory, worst stack, and
// instructions, which `-icount 10` makes countable: SysTick counts at 25 MHz, and each instruction takes
// 2^10 ns. Where the word at kProfileSwitch is not zero, it says instead where the instructions are spent:
// SysTick interrupts some of them.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <new>

#include "drivers/drive_catalogue.hpp"
#include "tests/m7/recording.hpp"
#include "toolchain/cortex-m7/semihosting.hpp"

extern "C" int run();
extern "C" void systick();

namespace {

using namespace wheelwright;
using bare::write;

// ---- the machine ----------------------------------------------------------------------------------------

const std::byte* const kRecord = reinterpret_cast<const std::byte*>(0x60000000);  // the board's PSRAM
const bool& kProfileSwitch = *reinterpret_cast<const bool*>(0x60FFFFF0);          // its end

// ARMv7-M B3.3
volatile std::uint32_t& timer(unsigned number) {
    return reinterpret_cast<volatile std::uint32_t*>(0xE000E010)[number];
}
constexpr std::uint32_t kSampled = 997;  // of so many instructions one
void start_counting() {
    timer(1) = kProfileSwitch ? kSampled * 256 / 10 : 0xFFFFFF;  // reload value
    timer(0) = kProfileSwitch ? 7 : 5;  // processor clock; with interrupts, or without
}
std::uint32_t ticks() { return timer(2); }  // counts down
// At most 650'000 can be told.
std::uint32_t instructions_since(std::uint32_t then) {
    constexpr std::uint32_t kTick_ns = 40;
    return (((then - ticks()) & 0xFFFFFF) * kTick_ns) >> 10U;
}

std::array<std::uint16_t, 64 * 1024> samples;  // by address / 4
volatile bool in_cycle = false;

// Of the stack, below the caller's frame.
constexpr std::size_t kPainted_bytes = 64 * 1024;
constexpr std::uint32_t kPaint = 0x5AFEC0DE;
std::uintptr_t painted_top = 0;

[[gnu::noinline]] void paint_stack() {
    painted_top = (reinterpret_cast<std::uintptr_t>(__builtin_frame_address(0)) & ~std::uintptr_t{3}) - 64;
    auto* const bottom = reinterpret_cast<volatile std::uint32_t*>(painted_top - kPainted_bytes);
    for (std::size_t i = 0; i < kPainted_bytes / 4; ++i) bottom[i] = kPaint;
}
std::uint32_t stack_used() {
    const auto* const bottom = reinterpret_cast<volatile std::uint32_t*>(painted_top - kPainted_bytes);
    std::size_t i = 0;
    while (i < kPainted_bytes / 4 && bottom[i] == kPaint) ++i;
    return static_cast<std::uint32_t>(kPainted_bytes - 4 * i);
}

// ---- the ports ------------------------------------------------------------------------------------------

// Takes what lies at `from`, and goes on behind it.
template <typename T>
const T& take(const std::byte*& from) {
    const T& value = *reinterpret_cast<const T*>(from);
    from += sizeof(T);
    return value;
}

// What is sent goes into the file `sent`, for the host to judge (compare.cpp).
class RecordedBus final : public hal::CanBus {
  public:
    void begin(const std::byte* frames, const m7::Told& told) {
        next_ = frames;
        left_ = told.received;
        now_ns_ = told.time.scheduled_ns;
        // A cycle's frames are far fewer than half.
        if (count_ >= sent_.size() / 2) flush();
    }
    hal::CanStatus send(const hal::CanFrame& frame) override {
        if (count_ == sent_.size()) return hal::CanStatus::would_block;
        sent_[count_++] = m7::frame_of(frame, now_ns_);
        return hal::CanStatus::ok;
    }
    void flush() {
        whole_ = bare::append(file_, sent_.data(), count_ * sizeof(m7::Frame)) && whole_;
        count_ = 0;
    }
    bool whole() const { return whole_; }  // the file is
    bool waits(std::uint32_t) const override { return false; }
    hal::CanStatus receive(hal::ReceivedFrame& out) override {
        if (left_ == 0) return hal::CanStatus::would_block;
        --left_;
        const auto& frame = take<m7::Frame>(next_);
        out.timestamp_ns = frame.time_ns;
        out.frame = {};
        out.frame.id = frame.id;
        out.frame.length = static_cast<std::uint8_t>(frame.length);
        std::copy(frame.data.begin(), frame.data.end(), out.frame.data.begin());
        return hal::CanStatus::ok;
    }
    bool set_filters(std::span<const hal::CanFilter>) override { return true; }
    hal::CanStatistics statistics() const override { return {}; }

  private:
    const std::byte* next_ = nullptr;
    std::uint32_t left_ = 0, count_ = 0;
    std::int64_t now_ns_ = 0;
    std::array<m7::Frame, 256> sent_;
    std::int32_t file_ = bare::create("sent");
    bool whole_ = file_ >= 0;
};

class RecordedStop final : public hal::DigitalInput {
  public:
    hal::LineLevel read() override { return level; }
    hal::LineLevel level = hal::LineLevel::inactive;
};
class EnableLine final : public hal::DigitalOutput {
  public:
    bool write(bool) override { return true; }
};

// ---- what is kept ---------------------------------------------------------------------------------------

// Never destroyed: there is no end.
template <typename T>
class Room {
  public:
    template <typename... Arguments>
    T& make(Arguments&&... arguments) {
        return *new (bytes_) T{std::forward<Arguments>(arguments)...};
    }

  private:
    alignas(T) std::byte bytes_[sizeof(T)];
};

model::RobotParameters parameters;
Room<RecordedBus> bus_room;
Room<RecordedStop> stop_room;
Room<EnableLine> enable_room;
Room<std::array<drivers::DriveSlot, 2>> drive_room;
Room<task::SaveMailbox> mailbox_room;
Room<task::Cycle> cycle_room;

// ---- comparison -----------------------------------------------------------------------------------------

// What is compared, and by how much float may leave double. Differences of torque in shares of the limit.
struct Quantity {
    const char* name;
    double tolerance;
};
// One to five times what was found over 30 s in the drive that is recorded (record.cpp), and far below what
// can be measured. A velocity loop's integral, which in a replay nothing brings back, adds up the rounding of
// speeds: the 2000 cycles of pose mode, each of 6e-8 of 1 m/s at the loop's gain, make two thousandths of the
// torque.
constexpr std::array kQuantities{
    Quantity{"torque / limit", 2e-3}, Quantity{"v, m/s", 1e-6},       Quantity{"omega, rad/s", 1e-5},
    Quantity{"position, m", 5e-6},    Quantity{"heading, rad", 5e-5}, Quantity{"K7 and K8, relative", 1e-5},
};
using Differences = std::array<double, kQuantities.size()>;

Differences differences(const m7::Outcome& a, const m7::Outcome& b, double limit_Nm) {
    const auto pair = [](double x, double y) { return std::max(std::abs(x), std::abs(y)); };
    return {pair(a.torque_Nm.left - b.torque_Nm.left, a.torque_Nm.right - b.torque_Nm.right) / limit_Nm,
            std::abs(a.twist.v_m_per_s - b.twist.v_m_per_s),
            std::abs(a.twist.omega_rad_per_s - b.twist.omega_rad_per_s),
            pair(a.pose.x_m - b.pose.x_m, a.pose.y_m - b.pose.y_m),
            std::abs(wrap_angle_rad(a.pose.heading_rad - b.pose.heading_rad)),
            pair(a.k7_per_kg_m / b.k7_per_kg_m - 1, a.k8_per_kg_m2 / b.k8_per_kg_m2 - 1)};
}

struct Part {
    std::uint32_t cycles = 0, most = 0, stack = 0, other_state = 0;
    std::uint64_t instructions = 0;
    Differences worst{};
};
std::array<Part, protocol::mode_values.size()> parts;

void write_millionths(double value) {
    write(static_cast<std::int32_t>(std::lround(std::min(value, 2000.0) * 1e6)));
}

void report(const char* name, const Part& part) {
    write(name);
    write(": ");
    write(static_cast<std::int32_t>(part.cycles));
    write(" cycles, instructions mean ");
    write(static_cast<std::int32_t>(part.instructions / part.cycles));
    write(" most ");
    write(static_cast<std::int32_t>(part.most));
    write(", stack ");
    write(static_cast<std::int32_t>(part.stack));
    write(" bytes; other state in ");
    write(static_cast<std::int32_t>(part.other_state));
    write("; differences, millionths:");
    for (const double worst : part.worst) {
        write(" ");
        write_millionths(worst);
    }
    write("\n");
}

// "sample ADDRESS INSTRUCTIONS", these in a thousand cycles.
void report_samples(std::uint32_t cycles) {
    for (std::size_t i = 0; i < samples.size(); ++i) {
        if (samples[i] == 0) continue;
        write("sample ");
        write(static_cast<std::int32_t>(4 * i));
        write(" ");
        write(static_cast<std::int32_t>(std::uint64_t{samples[i]} * kSampled * 1000 / cycles));
        write("\n");
    }
}

void report_memory() {
    const auto line = [](const char* name, std::size_t bytes) {
        write("ram ");
        write(name);
        write(" ");
        write(static_cast<std::int32_t>(bytes));
        write("\n");
    };
    line("parameters", sizeof(model::RobotParameters));
    line("drives", 2 * sizeof(drivers::DriveSlot));
    line("identification", sizeof(ident::IdentificationRun<Real>));
    line("adaptation", sizeof(ident::AdaptiveEstimator<Real>) + sizeof(ident::ModelGuard<Real>));
    line("senses", sizeof(task::Senses));
    line("encoder watch", sizeof(control::EncoderWatch));
    line("control", sizeof(task::MotionControl));
    line("cycle, all of the above but parameters and drives", sizeof(task::Cycle));
}

}  // namespace

// ARMv7-M B1.5.7: where it was interrupted lies on the stack.
extern "C" {
[[gnu::used]] void take_sample(const std::uint32_t* frame) {
    if (in_cycle) ++samples[frame[6] / 4 % samples.size()];
}
[[gnu::naked]] void systick() { asm volatile("mov r0, sp\n b take_sample\n"); }
}

int run() {
    const std::byte* at = kRecord;
    const auto& beginning = take<m7::Beginning>(at);
    if (beginning.magic != m7::Beginning::kMagic || beginning.parameters_bytes != sizeof(parameters)) {
        write("no record, or one of other parameters\n");
        return 2;
    }
    parameters = take<model::RobotParameters>(at);
    RecordedBus& bus = bus_room.make();
    RecordedStop& stop = stop_room.make();
    auto& drives = drive_room.make();
    drivers::MotorDrive* const left = drivers::make_drive(drives[0], parameters, drivers::Wheel::left);
    drivers::MotorDrive* const right = drivers::make_drive(drives[1], parameters, drivers::Wheel::right);
    if (left == nullptr || right == nullptr) return 2;
    const task::CyclePorts ports{bus, nullptr, *left, *right, &stop, &enable_room.make()};
    task::Cycle& cycle = cycle_room.make(parameters, mailbox_room.make(), ports);

    start_counting();
    paint_stack();
    for (std::uint32_t i = 0; i < beginning.cycles; ++i) {
        const auto& told = take<m7::Told>(at);
        const auto& recorded = take<m7::Outcome>(at);
        bus.begin(at, told);
        at += told.received * sizeof(m7::Frame);
        stop.level = told.stop_line;
        const std::uint32_t start = ticks();
        in_cycle = true;
        cycle.think(told.time);
        in_cycle = false;
        const std::uint32_t thought = instructions_since(start);
        const m7::Outcome outcome = m7::outcome_of(cycle);
        cycle.pretend_output(WheelPair<Real>(recorded.torque_Nm));
        const std::uint32_t sending = ticks();
        in_cycle = true;
        cycle.send(told.sending_ns);
        in_cycle = false;
        const std::uint32_t spent = thought + instructions_since(sending);

        Part& part = parts[std::size_t(recorded.state.mode)];
        ++part.cycles;
        part.instructions += spent;
        part.most = std::max(part.most, spent);
        part.other_state += task::CycleState::of(cycle.supervisor()) != recorded.state;
        const Differences now = differences(outcome, recorded, parameters.limits.torque_Nm);
        for (std::size_t q = 0; q < now.size(); ++q) part.worst[q] = std::max(part.worst[q], now[q]);
        const auto* const next = reinterpret_cast<const m7::Outcome*>(at + sizeof(m7::Told));
        if (i + 1 == beginning.cycles || next->state.mode != recorded.state.mode) {
            part.stack = std::max(part.stack, stack_used());
            paint_stack();
        }
    }

    bus.flush();
    if (kProfileSwitch) {
        timer(0) = 0;
        report_samples(beginning.cycles);
        return 0;
    }
    report_memory();
    bool good = bus.whole();
    for (const protocol::Mode mode : protocol::mode_values) {
        const Part& part = parts[std::size_t(mode)];
        if (part.cycles == 0) continue;
        const std::string_view name = protocol::to_string_view(mode);
        report(name.data(), part);
        for (std::size_t q = 0; q < kQuantities.size(); ++q)
            good = good && part.worst[q] <= kQuantities[q].tolerance;
        good = good && part.other_state == 0;
    }
    return good ? 0 : 3;
}
