#include "tools/gap_trials/hidden/robot.hpp"

namespace wheelwright::hidden {

Robot draw_robot(Random& random) {
    const auto about = [&](double nominal) { return nominal * random.uniform(0.92, 1.08); };
    Robot robot;
    robot.wheel_radius_m = about(0.083);
    robot.track_m = about(0.371);
    robot.mass_kg = about(11.3);
    robot.yaw_inertia_kg_m2 = about(0.342);
    robot.cog_ahead_m = about(0.046);
    robot.cog_height_m = about(0.062);
    robot.wheel_mass_kg = about(0.57);
    robot.wheel_inertia_kg_m2 = about(0.0041);
    robot.castor_ahead_m = about(0.167);
    const double acceleration_m_per_s2 = random.uniform(2.4, 3.6);
    robot.torque_limit_Nm = robot.effective_mass_kg() * robot.wheel_radius_m * acceleration_m_per_s2 / 2;
    return robot;
}

}  // namespace wheelwright::hidden
