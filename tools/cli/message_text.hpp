// Frames of our protocol as text with names and units, by the generated code's own tables.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/protocol/wheelwright_messages.hpp"
#include "hal/can_bus.hpp"

namespace wheelwright::tools {

struct FieldText {
    std::string name;   // of the field, with its unit
    std::string value;  // a number, or a value table's name
    std::string unit;
};

struct MessageText {
    std::string name;
    std::string sender;
    std::vector<FieldText> fields;  // without Crc and Alive
    std::string error;              // why the frame cannot be decoded; "" when it can
};

// Nothing when the frame's identifier is not one of ours. A sealed frame with a wrong CRC has an error.
std::optional<MessageText> describe(const hal::CanFrame& frame);

// "Status  state idle  requested idle ..." in one line.
std::string one_line(const MessageText& message);

// What the drives report as their errors, each latest.
class DriveErrors {
  public:
    void take(const protocol::DriveError& error) { latest_[std::size_t(error.wheel)] = error; }
    // "the left drive reports estop_requested (0x4000)", of both "...; the right drive ..."; "" without any.
    std::string text() const;

  private:
    std::array<protocol::DriveError, 2> latest_{protocol::DriveError{.wheel = protocol::Wheel::left},
                                                protocol::DriveError{.wheel = protocol::Wheel::right}};
};

// What to look at when the drives are not armed; "" when nothing hints at it.
std::string advice(const protocol::Status& status, const DriveErrors& errors = {});

// "the period is 13.20 s in place of 10.00 s, so that limits.torque_Nm ..."; "" when it is as asked.
std::string pace_sentence(const protocol::TrajectoryPace& pace);

// "ID#DATA" as cansend and candump write it.
std::string frame_text(const hal::CanFrame& frame);

}  // namespace wheelwright::tools
