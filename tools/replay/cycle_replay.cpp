#include "tools/replay/cycle_replay.hpp"

#include <cstring>
#include <memory>

#include "drivers/drive_catalogue.hpp"
#include "firmware/task/build_identity.hpp"
#include "firmware/task/cycle.hpp"
#include "hal/linux/candump.hpp"

namespace wheelwright::tools {
namespace {

using task::BoxCycle;
using task::BoxFrame;
using task::RecordKind;

bool same(const hal::CanFrame& a, const hal::CanFrame& b) {
    return a.id == b.id && a.length == b.length && a.extended == b.extended && a.remote == b.remote &&
           a.fd == b.fd && a.bit_rate_switch == b.bit_rate_switch && a.error == b.error &&
           (a.remote || std::memcmp(a.data.data(), b.data.data(), a.length) == 0);
}

// The recorded cycle that runs now, from which all ports take.
class Script {
  public:
    explicit Script(const std::array<std::string, 2>& interface) : interface_(interface) {}

    void begin(const BoxCycle& cycle) {
        cycle_ = &cycle;
        sent_ = 0;
        next_ = {};
        what_.clear();
        if (!cycle.statistics.empty()) statistics_ = cycle.statistics.back();
    }
    // After the cycle. "" or the first difference.
    std::string end() {
        if (!what_.empty()) return what_;
        if (const BoxFrame* left = nth_sent(sent_)) {
            return "frame " + std::to_string(sent_ + 1) + ": recorded " +
                   text(left->bus, left->received.frame) + ", replayed none";
        }
        for (const std::uint8_t bus : {std::uint8_t{0}, std::uint8_t{1}}) {
            if (next_received(bus) != nullptr) return "a received frame was not taken";
        }
        return "";
    }

    hal::CanStatus send(std::uint8_t bus, const hal::CanFrame& frame) {
        const BoxFrame* const recorded = nth_sent(sent_++);
        if (what_.empty() &&
            (recorded == nullptr || recorded->bus != bus || !same(recorded->received.frame, frame))) {
            what_ = "frame " + std::to_string(sent_) + ": recorded " +
                    (recorded == nullptr ? "none" : text(recorded->bus, recorded->received.frame)) +
                    ", replayed " + text(bus, frame);
        }
        const bool refused = recorded != nullptr && recorded->kind == RecordKind::refused;
        return refused ? hal::CanStatus::would_block : hal::CanStatus::ok;
    }
    hal::CanStatus receive(std::uint8_t bus, hal::ReceivedFrame& out) {
        if (const BoxFrame* const frame = next_received(bus)) {
            ++next_[bus];
            out = frame->received;
            return hal::CanStatus::ok;
        }
        return cycle_->told.inputs.bus_down[bus] ? hal::CanStatus::bus_down : hal::CanStatus::would_block;
    }
    bool waits(std::uint8_t bus, std::uint32_t id) {
        for (const BoxFrame& frame : cycle_->frames) {
            if (frame.kind == RecordKind::waits && frame.bus == bus && frame.received.frame.id == id)
                return true;
        }
        return false;
    }
    const task::CycleInputs& inputs() const { return cycle_->told.inputs; }
    task::BoxStatistics& statistics() { return statistics_; }

  private:
    const BoxFrame* nth_sent(std::size_t n) const {
        for (const BoxFrame& frame : cycle_->frames) {
            if (frame.kind != RecordKind::sent && frame.kind != RecordKind::refused) continue;
            if (n-- == 0) return &frame;
        }
        return nullptr;
    }
    const BoxFrame* next_received(std::uint8_t bus) {
        std::size_t& next = next_[bus];
        while (next < cycle_->frames.size() &&
               (cycle_->frames[next].kind != RecordKind::received || cycle_->frames[next].bus != bus)) {
            ++next;
        }
        return next < cycle_->frames.size() ? &cycle_->frames[next] : nullptr;
    }
    std::string text(std::uint8_t bus, const hal::CanFrame& frame) const {
        hal::LogFrame line;
        line.interface = interface_[bus];
        line.frame = frame;
        const std::string whole = hal::format_candump_line(line);
        return whole.substr(whole.find(' ') + 1);  // without its time
    }

    std::array<std::string, 2> interface_;
    const BoxCycle* cycle_ = nullptr;
    std::size_t sent_ = 0;
    std::array<std::size_t, 2> next_{};
    std::string what_;
    task::BoxStatistics statistics_;
};

class ScriptBus final : public hal::CanBus {
  public:
    ScriptBus(Script& script, std::uint8_t number) : script_(script), number_(number) {}
    hal::CanStatus send(const hal::CanFrame& frame) override { return script_.send(number_, frame); }
    bool waits(std::uint32_t id) const override { return script_.waits(number_, id); }
    hal::CanStatus receive(hal::ReceivedFrame& out) override { return script_.receive(number_, out); }
    bool set_filters(std::span<const hal::CanFilter>) override { return true; }
    hal::CanStatistics statistics() const override {
        hal::CanStatistics statistics;
        statistics.receive_overflow = script_.statistics().receive_overflow;
        statistics.error_frames = script_.statistics().error_frames;
        statistics.bus_off = script_.statistics().bus_off;
        return statistics;
    }

  private:
    Script& script_;
    std::uint8_t number_;
};

class ScriptStop final : public hal::DigitalInput {
  public:
    explicit ScriptStop(Script& script) : script_(script) {}
    hal::LineLevel read() override { return script_.inputs().stop_line; }

  private:
    Script& script_;
};

class ScriptEnable final : public hal::DigitalOutput {
  public:
    explicit ScriptEnable(Script& script) : script_(script) {}
    bool write(bool) override { return script_.inputs().enable_written; }

  private:
    Script& script_;
};

std::string state_text(const task::CycleState& s) {
    return std::string(protocol::to_string_view(s.mode)) + ", fault " +
           std::string(protocol::to_string_view(s.fault)) + ", phase " + std::to_string(unsigned(s.phase)) +
           ", owner " + std::to_string(unsigned(s.owner)) + ", requested " +
           std::string(protocol::to_string_view(s.requested)) + ", blocker " +
           std::string(protocol::to_string_view(s.blocker));
}

// Writes the memory to where it belongs. False: it has another size.
bool restore(task::Cycle& cycle, task::BoxStatistics& statistics, std::span<const std::byte> memory) {
    const auto take = [&memory](std::span<std::byte> to) {
        if (memory.size() < to.size()) return false;
        std::memcpy(to.data(), memory.data(), to.size());
        memory = memory.subspan(to.size());
        return true;
    };
    for (const auto& part : cycle.memory()) {
        if (!take(part)) return false;
    }
    return take(std::as_writable_bytes(std::span(&statistics, 1))) && memory.empty();
}

}  // namespace

ReplayResult replay(const task::BlackBoxFile& file) {
    ReplayResult result;
    if (file.about.build != task::build_identity()) {
        result.problem = "it was recorded by the build " + file.about.build + ", and this is " +
                         task::build_identity() + ": only the same build has the same cycle";
        return result;
    }
    model::RobotParameters parameters = model::default_parameters();
    parameters.drive.generation = file.about.drive_generation;
    drivers::DriveSlot left_slot;
    drivers::DriveSlot right_slot;
    drivers::MotorDrive* const left = drivers::make_drive(left_slot, parameters, drivers::Wheel::left);
    drivers::MotorDrive* const right = drivers::make_drive(right_slot, parameters, drivers::Wheel::right);
    if (left == nullptr || right == nullptr) {
        result.problem = "its motor drive is unknown";
        return result;
    }
    Script script(file.about.interface);
    ScriptBus drive_bus(script, 0);
    ScriptBus host_bus(script, 1);
    ScriptStop stop(script);
    ScriptEnable enable(script);
    task::SaveMailbox mailbox;
    const auto cycle = std::make_unique<task::Cycle>(
        parameters, mailbox,
        task::CyclePorts{drive_bus, file.about.interface[1].empty() ? nullptr : &host_bus, *left, *right,
                         file.about.stop_line ? &stop : nullptr, file.about.enable_line ? &enable : nullptr});
    if (!restore(*cycle, script.statistics(), file.memory)) {
        result.problem = "its memory has another size than this build's";
        return result;
    }
    for (auto i = static_cast<std::size_t>(file.memory_cycle + 1 - file.first_cycle); i < file.cycles.size();
         ++i) {
        const BoxCycle& recorded = file.cycles[i];
        const task::CycleRecord& told = recorded.told;
        script.begin(recorded);
        mailbox.pretend(told.inputs.save);
        if (told.inputs.terminate) cycle->request_termination();
        cycle->think(told.time);
        cycle->send(told.sending_ns);
        std::string what = script.end();
        const task::CycleState state = task::CycleState::of(cycle->supervisor());
        if (what.empty() && state != told.state) {
            what = "state: recorded " + state_text(told.state) + "; replayed " + state_text(state);
        }
        if (!what.empty()) {
            result.difference = {file.first_cycle + i, told.time.scheduled_ns + file.about.offset_ns, what};
            return result;
        }
        ++result.cycles;
        for (const BoxFrame& frame : recorded.frames) {
            if (frame.kind == RecordKind::received) ++result.received;
            if (frame.kind == RecordKind::sent || frame.kind == RecordKind::refused) ++result.sent;
        }
    }
    return result;
}

}  // namespace wheelwright::tools
