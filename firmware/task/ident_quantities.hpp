// What an identification has found by its probe and chosen for the robot, as telemetry tells it: by the
// numbers of the DBC's value table IdentQuantity.
#pragma once

#include <array>
#include <cstddef>

#include "firmware/ident/sizing.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::task {

using IdentQuantities = std::array<double, protocol::ident_quantity_values.size()>;

inline IdentQuantities ident_quantities(const ident::Sizing& sizing, const ident::ProbeFindings& found) {
    using enum protocol::IdentQuantity;
    IdentQuantities to{};
    const auto put = [&to](protocol::IdentQuantity which, double value) { to[std::size_t(which)] = value; };
    put(amplitude, sizing.amplitude_Nm);
    put(bit_time, sizing.bit_time_s);
    put(kernel, sizing.kernel_s);
    put(speed_limit, sizing.speed_limit_m_per_s);
    put(yaw_rate_limit, sizing.yaw_rate_limit_rad_per_s);
    put(coupling_standard_error, sizing.coupling_standard_error_m);
    put(angle_noise, found.angle_noise_rad);
    put(left_breakaway, found.breakaway_Nm.left);
    put(right_breakaway, found.breakaway_Nm.right);
    put(friction, found.friction_Nm);
    put(rough_k7, found.k7_per_kg_m);
    put(rough_k8, found.k8_per_kg_m2);
    put(delivered_torque, found.torque_limit_Nm);
    put(report_ratio, found.report_ratio);
    return to;
}

}  // namespace wheelwright::task
