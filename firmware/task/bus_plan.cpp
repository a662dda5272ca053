#include "firmware/task/bus_plan.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include "drivers/drive_catalogue.hpp"
#include "firmware/protocol/bus_load.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::task {
namespace {

std::string percent(double share) {
    std::array<char, 24> text{};
    std::snprintf(text.data(), text.size(), "%.1f %%", share * 100);
    return text.data();
}

std::string over_limit(const char* which, double load, const std::vector<PlannedFrame>& frames,
                       bool drives_only, bool host_only, double limit) {
    if (load <= limit) return "";
    std::string text = std::string("the ") + which + " would be " + percent(load) +
                       " full in the worst case, and bus.load_limit is " + percent(limit) + "; largest: ";
    int named = 0;
    for (const PlannedFrame& frame : frames) {
        if ((drives_only && !frame.drives) || (host_only && frame.drives)) continue;
        if (named++ == 6) break;
        if (named > 1) text += ", ";
        text += frame.name + " " + percent(frame.load);
    }
    return text;
}

}  // namespace

BusPlan bus_plan(const model::RobotParameters& parameters) {
    BusPlan plan;
    const auto add = [&](const std::string& name, std::uint8_t length, bool extended, double period_s,
                         bool drives) {
        if (period_s <= 0) return;
        const double rate =
            drives ? parameters.bus.bit_rate_bit_per_s : parameters.bus.host_bit_rate_bit_per_s;
        const protocol::PeriodicFrame frame{name, length, extended, period_s};
        const double load = protocol::load_fraction(frame, rate);
        plan.frames.push_back({name, drives, period_s, load});
        (drives ? plan.drive_load : plan.host_load) += load;
        plan.shared_load += protocol::load_fraction(frame, parameters.bus.bit_rate_bit_per_s);
    };
    for (const drivers::Wheel wheel : {drivers::Wheel::left, drivers::Wheel::right}) {
        drivers::DriveSlot slot;
        const drivers::MotorDrive* drive = drivers::make_drive(slot, parameters, wheel);
        if (drive == nullptr) continue;  // nothing drives with it either
        const std::string of = wheel == drivers::Wheel::left ? "left " : "right ";
        for (const drivers::DriveFrame& frame : drive->frames()) {
            add(of + std::string(frame.name), frame.length, frame.extended, frame.period_s, true);
        }
    }
    for (const protocol::MessageInfo& message : protocol::all_messages) {
        add(std::string(message.name), message.length, message.extended, message.cycle_time_ms * 1e-3, false);
    }
    std::stable_sort(plan.frames.begin(), plan.frames.end(),
                     [](const PlannedFrame& a, const PlannedFrame& b) { return a.load > b.load; });
    return plan;
}

std::string bus_refusal(const BusPlan& plan, const model::RobotParameters& parameters, bool shared) {
    const double limit = parameters.bus.load_limit;
    if (shared) {
        return over_limit("bus shared by drives and host", plan.shared_load, plan.frames, false, false,
                          limit);
    }
    const std::string drives = over_limit("drives' bus", plan.drive_load, plan.frames, true, false, limit);
    return drives.empty() ? over_limit("host's bus", plan.host_load, plan.frames, false, true, limit)
                          : drives;
}

}  // namespace wheelwright::task
