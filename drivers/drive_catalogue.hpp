// The motor drives this firmware can talk to. To add a dialect: implement MotorDrive, add the class to
// DriveSlot's variant and a line to kDriveCatalogue.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <variant>

#include "drivers/motor_drive.hpp"
#include "drivers/odrive/odrive_drive.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::drivers {

// Room for one drive of any dialect, in place: making one allocates nothing.
class DriveSlot {
  public:
    template <typename Drive, typename Config>
    MotorDrive& make(const Config& config) {
        return room_.template emplace<Drive>(config);
    }

  private:
    std::variant<std::monostate, OdriveDrive> room_;
};

struct DriveInfo {
    std::int32_t generation;  // drive.generation of the robot file
    std::string_view name;
    MotorDrive& (*make)(DriveSlot& slot, const model::RobotParameters& parameters, Wheel wheel);
};

inline MotorDrive& make_odrive(DriveSlot& slot, const model::RobotParameters& parameters, Wheel wheel) {
    return slot.make<OdriveDrive>(odrive_config(parameters, wheel));
}

inline constexpr std::array kDriveCatalogue{
    DriveInfo{5, "ODrive CANSimple 0.5", &make_odrive},
    DriveInfo{6, "ODrive CANSimple 0.6", &make_odrive},
};

// The drive the robot file asks for, living in `slot`; nullptr when the catalogue has none such.
inline MotorDrive* make_drive(DriveSlot& slot, const model::RobotParameters& parameters, Wheel wheel) {
    for (const DriveInfo& info : kDriveCatalogue) {
        if (info.generation == parameters.drive.generation) return &info.make(slot, parameters, wheel);
    }
    return nullptr;
}

}  // namespace wheelwright::drivers
