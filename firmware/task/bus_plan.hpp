// The worst case of what will be on the bus, from the robot file alone: known before the first frame is sent.
// Allocates; start-up and tools only.
#pragma once

#include <string>
#include <vector>

#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::task {

struct PlannedFrame {
    std::string name;     // "left Get_Encoder_Estimates", "Status"
    bool drives = false;  // on the drives' bus; otherwise on the host's
    double period_s = 0;
    double load = 0;  // share of its bus, at worst-case length
};

// Loads are shares of the bus they are on, 1 = full.
struct BusPlan {
    std::vector<PlannedFrame> frames;  // largest load first
    double drive_load = 0;             // drives alone, at bus.bit_rate_bit_per_s
    double host_load = 0;              // host alone, at bus.host_bit_rate_bit_per_s
    double shared_load = 0;            // both on one bus, at bus.bit_rate_bit_per_s
};

// Drives: what each driver lists as its periodic frames (MotorDrive::frames()). Host: all cyclic telemetry
// and one host that sends every set-point message at its nominal rate; more than one mode's set-points at
// once are not usual, so this is on the safe side. Event-driven frames take no part.
BusPlan bus_plan(const model::RobotParameters& parameters);

// "" when the plan keeps bus.load_limit; else one sentence that names the bus and its largest messages.
std::string bus_refusal(const BusPlan& plan, const model::RobotParameters& parameters, bool shared);

}  // namespace wheelwright::task
