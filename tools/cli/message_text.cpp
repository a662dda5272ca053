#include "tools/cli/message_text.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <type_traits>

#include "firmware/protocol/command_guard.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "tools/cli/parameter_names.hpp"
#include "tools/logs/candump.hpp"

namespace wheelwright::tools {
namespace {

template <typename Number>
std::string shortest(Number value) {
    std::array<char, 48> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    return {digits.data(), end};
}

// A scaled value with the decimals its step has.
std::string scaled_text(double value, double step) {
    if (step <= 0 || step >= 1) return shortest(value);
    int decimals = 0;
    for (double scale = step; decimals < 9 && std::abs(scale - std::round(scale)) > 1e-6; scale *= 10) {
        ++decimals;
    }
    std::array<char, 48> digits{};
    std::snprintf(digits.data(), digits.size(), "%.*f", decimals, value);
    return digits.data();
}

template <typename Field>
std::string value_text(const Field& value, const protocol::FieldInfo& info) {
    if constexpr (std::is_enum_v<Field>) {
        return std::string(to_string_view(value));
    } else if constexpr (std::is_same_v<Field, bool>) {
        return value ? "yes" : "no";
    } else if constexpr (std::is_same_v<Field, float>) {
        return shortest(value);
    } else if constexpr (std::is_floating_point_v<Field>) {
        return scaled_text(value, info.step);
    } else {
        return std::to_string(value);
    }
}

template <typename Message>
void fill(const hal::CanFrame& frame, MessageText& text) {
    text.name = Message::name;
    text.sender = Message::sender;
    const std::span<const std::uint8_t> bytes(frame.data.data(), frame.length);
    if constexpr (Message::sealed) {
        if (bytes.size() == Message::length && bytes[0] != protocol::seal_crc(bytes)) {
            text.error = "wrong_crc";
            return;
        }
    }
    Message message;
    const protocol::CodecStatus status = Message::decode(bytes, message);
    if (status != protocol::CodecStatus::ok) {
        text.error = to_string_view(status);
        return;
    }
    Message::for_each_field(message, [&](const protocol::FieldInfo& info, const auto& value) {
        if (info.name == "crc" || info.name == "alive") return;
        text.fields.push_back({std::string(info.name), value_text(value, info), std::string(info.unit)});
    });
}

}  // namespace

std::optional<MessageText> describe(const hal::CanFrame& frame) {
    if (frame.extended || frame.error || frame.remote || frame.fd) return std::nullopt;
    MessageText text;
    bool found = false;
    protocol::AllMessages::for_each([&]<typename Message>() {
        if (frame.id != Message::id) return;
        found = true;
        fill<Message>(frame, text);
    });
    if (!found) return std::nullopt;
    return text;
}

std::string one_line(const MessageText& message) {
    std::string line = message.name;
    if (!message.error.empty()) return line + "  bad frame: " + message.error;
    for (const FieldText& field : message.fields) {
        line.append("  ").append(field.name).append(" ").append(field.value);
    }
    return line;
}

std::string advice(const protocol::Status& status) {
    using protocol::DriveState;
    const bool left = status.drive_left == DriveState::other_generation;
    if (left || status.drive_right == DriveState::other_generation) {
        return std::string("the ") + (left ? "left" : "right") +
               " drive's frames are not those of the generation in the robot file: check drive.generation";
    }
    if (status.blocker == protocol::Blocker::watchdog_not_confirmed) {
        return "see drive.watchdog_assured and drive.watchdog_endpoint in the robot file, and check "
               "drive.generation";
    }
    const bool silent = status.drive_left == DriveState::silent || status.drive_right == DriveState::silent;
    if (status.fault == protocol::Fault::arming_refused && !silent) {
        return "a drive is heard and does not arm: check its errors, and drive.generation in the robot file";
    }
    return "";
}

std::string frame_text(const hal::CanFrame& frame) {
    LogFrame entry;
    entry.frame = frame;
    const std::string line = format_candump_line(entry);
    return line.substr(line.rfind(' ') + 1);
}

}  // namespace wheelwright::tools
