// The line to one firmware on a SocketCAN interface: sends commands with fresh alive counters, listens to
// what comes back, asks for indexed parameters. What goes wrong is said on standard error, once.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "hal/message_code.hpp"
#include "tools/cli/can_port.hpp"
#include "tools/cli/command.hpp"
#include "tools/cli/message_text.hpp"
#include "tools/ctl/frames.hpp"

namespace wheelwright::tools {

struct LinkOptions {
    std::string interface = "can0";
    int alive = -1;   // the first alive counter; -1: chosen
    std::string key;  // key file, to answer a robot that asks for it; "": none
    std::string program = "wheelwright ctl";

    // Says it on standard error; returns the status.
    int complain(int status, const std::string& text) const;
};

std::string status_text(const protocol::Status& status, const DriveErrors& errors = {});

class Link {
  public:
    // `options` outlive the link.
    explicit Link(const LinkOptions& options) : options_(options) {}

    // kDone, or the exit status.
    int open();

    // Of another call of this program within the same slot the firmware would refuse the counter.
    static void leave_slot();

    int send(const Command& command);

    // Asks for a mode. With a key, the robot's challenge is answered whenever this program waits for frames.
    int ask(protocol::Mode mode);
    // For who does not wait otherwise: until the mode that was asked for is on its way, or refused.
    void prove();
    // Whether what blocks the mode that was asked for may pass. Asks again when the firmware did not hear the
    // request, and once it hears drives that it did not hear when it was asked.
    bool keeps_trying(const protocol::Status& status);
    std::int64_t longest_arming_ns() const;

    // From now on HostAlive is sent whenever this program waits for frames, as the firmware stops what needs
    // no set-points when nobody is there.
    void stay_alive() { stays_alive_ = true; }

    // Waits for the next message of this kind; nothing when none comes in time.
    template <typename Message>
    std::optional<Message> wait_for(std::int64_t deadline_ns) {
        hal::CanFrame frame;
        while (receive(frame, deadline_ns)) {
            if (const auto message = decoded<Message>(frame)) return message;
        }
        return std::nullopt;
    }

    // Waits for the next frame of any kind.
    bool receive(hal::CanFrame& frame, std::int64_t deadline_ns);

    template <typename Message>
    static std::optional<Message> decoded(const hal::CanFrame& frame) {
        Message message;
        if (frame.id != Message::id || Message::decode(std::span(frame.data.data(), frame.length), message) !=
                                           protocol::CodecStatus::ok) {
            return std::nullopt;
        }
        return message;
    }

    // What came before the command says nothing about its effect.
    void forget_received();

    // Sends a request until its reply comes, three times at most; of a save, the reply that ends it. Nothing:
    // `status` is the exit status, and why has been said.
    std::optional<protocol::ParameterReply> ask(protocol::ParameterOperation operation, std::uint16_t index,
                                                float value, int& status);

    // How the robot moves, by what came in while waiting.
    const protocol::BodyState& body() const { return body_; }
    // Status in words, with what the drives have reported meanwhile.
    std::string text_of(const protocol::Status& status) const;
    const DriveErrors& drive_errors() const { return errors_; }

    const LinkOptions& options() const { return options_; }

  private:
    static std::uint8_t alive_of_slot();
    std::uint8_t next_alive(const Command& command);
    int read_key();
    bool answer(const protocol::ArmingChallenge& challenge);

    const LinkOptions& options_;
    std::unique_ptr<hal::SocketCanBus> bus_;
    protocol::BodyState body_;
    DriveErrors errors_;
    std::uint8_t first_alive_ = 0;
    bool stays_alive_ = false;
    std::int64_t alive_due_ns_ = 0;
    std::unique_ptr<hal::MessageCode> code_;        // null: no key
    std::string robot_;                             // the key's
    protocol::Mode wanted_ = protocol::Mode::idle;  // the mode last asked for, and when
    std::int64_t wanted_ns_ = 0;
    bool taken_ = false;                   // the firmware has said since that this is the mode requested
    std::optional<protocol::Mode> asked_;  // the mode that a challenge is about
    protocol::ArmingChallenge answered_;   // the last one, and when
    std::int64_t answered_ns_ = 0;
    std::vector<std::pair<std::string, std::uint8_t>> alive_;
};

// Follows the robot into a mode and through it while set-points are repeated. Arming the drives takes a
// while; a refusal is final, and so is that the robot has left the mode again.
class ModeWatch {
  public:
    ModeWatch(protocol::Mode wanted, std::int64_t asked_ns) : wanted_(wanted), asked_ns_(asked_ns) {}

    // What Status says until `deadline_ns`; false as soon as there is no need to go on.
    bool follow(Link& link, std::int64_t deadline_ns);
    bool entered() const { return entered_; }
    // No Status for half a second, though followed.
    bool silent() const;
    bool in_fault() const { return last_.has_value() && last_->state == protocol::Mode::fault; }
    // What became of it, as an exit status; said unless it is kDone.
    int result(const Link& link) const;

  private:
    protocol::Mode wanted_;
    std::int64_t asked_ns_;
    bool entered_ = false;
    std::optional<protocol::Status> last_;
    std::int64_t heard_ns_ = 0;
};

Command mode_command(protocol::Mode mode);
Command parameter_request(protocol::ParameterOperation operation, std::uint16_t index, float value);

std::string result_text(protocol::ParameterResult result);

// The float to send: the nearest one, or the next inside the range when rounding has left it.
float float_within(double value, double minimum, double maximum);

}  // namespace wheelwright::tools
