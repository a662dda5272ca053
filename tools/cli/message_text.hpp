// Frames of our protocol as text with names and units, by the generated code's own tables.
#pragma once

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

// What to look at when the drives are not armed; "" when nothing hints at it.
std::string advice(const protocol::Status& status);

// "ID#DATA" as cansend and candump write it.
std::string frame_text(const hal::CanFrame& frame);

}  // namespace wheelwright::tools
