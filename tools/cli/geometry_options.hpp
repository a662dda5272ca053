// The wheels' radius and the track, on the command line: in place of a robot file's, or beside one.
#pragma once

#include <vector>

#include "firmware/model/dynamics.hpp"
#include "tools/cli/command_line.hpp"

namespace wheelwright::tools {

struct GeometryOptions {
    std::vector<double> wheel_radius_m;  // none, one, or left and right
    double track_m = 0;                  // 0: not given

    void add_to(const CommandLine& command) {
        command.add_option("--wheel-radius", wheel_radius_m, "Radius in metres; two numbers: left and right")
            .values(1, 2)
            .check(greater_than_zero());
        command.add_option("--track", track_m, "Distance between the wheels in metres")
            .check(greater_than_zero());
    }

    // Puts what was given into `geometry`. Without a robot file all must be given: else false.
    [[nodiscard]] bool apply(model::Geometry<double>& geometry, bool has_robot_file) const {
        if (!wheel_radius_m.empty()) {
            geometry.wheel_radius_m = {wheel_radius_m.front(), wheel_radius_m.back()};
        }
        if (track_m > 0) geometry.track_m = track_m;
        return has_robot_file || (!wheel_radius_m.empty() && track_m > 0);
    }
};

inline constexpr const char* kGeometryMissing =
    "the geometry is missing: give --model ROBOT.toml, or --wheel-radius and --track in metres";

}  // namespace wheelwright::tools
