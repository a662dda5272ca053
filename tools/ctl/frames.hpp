// Command frames as `wheelwright ctl` sends and prints them.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <type_traits>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "hal/can_bus.hpp"
#include "tools/cli/report.hpp"

namespace wheelwright::tools {

// Makes the frame for an alive counter. Returns "" or what is wrong with its values.
using MakeFrame = std::function<std::string(std::uint8_t alive, hal::CanFrame& out)>;

struct Command {
    std::string name;     // the message's
    double period_s = 0;  // nominal; 0: sent once
    MakeFrame make;
};

// Names the field that does not fit; "" when all do.
template <typename Message>
std::string field_error(Message& message) {
    std::string text;
    Message::for_each_field(message, [&](const protocol::FieldInfo& info, const auto& field) {
        using Field = std::remove_cvref_t<decltype(field)>;
        if constexpr (std::is_floating_point_v<Field>) {
            const double value = field;
            const double slack = info.step / 2;
            if (text.empty() && !(value >= info.minimum - slack && value <= info.maximum + slack)) {
                text = std::string(info.name) + ": found " + number_text(value) + ", expected " +
                       number_text(info.minimum) + " to " + number_text(info.maximum);
                if (!info.unit.empty()) text.append(" ").append(info.unit);
            }
        }
    });
    return text;
}

template <typename Message>
Command command_of(Message message) {
    const auto make = [message](std::uint8_t alive, hal::CanFrame& out) mutable -> std::string {
        if (std::string wrong = field_error(message); !wrong.empty()) return wrong;
        out = {};
        out.id = Message::id;
        out.length = Message::length;
        const std::span<std::uint8_t> bytes(out.data.data(), Message::length);
        protocol::CodecStatus status = protocol::CodecStatus::ok;
        if constexpr (Message::sealed) {
            status = protocol::encode_sealed(message, alive, bytes);
        } else {
            status = message.encode(bytes);
        }
        if (status == protocol::CodecStatus::ok) return "";
        return std::string(Message::name) + ": " + std::string(to_string_view(status));
    };
    return {std::string(Message::name), Message::cycle_time_ms * 1e-3, make};
}

}  // namespace wheelwright::tools
