// The indexed parameters over CAN: writes are staged, checked at once, and take effect together on commit.
// Saving to the robot file is not done here: a snapshot is handed to a thread that may wait for a disk.
//
// Threads: all calls from the cycle's thread, except SaveMailbox, which is shared with the saving thread.
// No call allocates or blocks.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "firmware/model/robot_parameters.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "hal/plain_memory.hpp"

namespace wheelwright::task {

// One changed parameter, by CAN index.
struct ChangedParameter {
    std::uint16_t index = 0;
    double value = 0;
};

inline constexpr std::size_t kMaxChanged = 192;

struct ChangedParameters {
    std::array<ChangedParameter, kMaxChanged> items;
    std::size_t count = 0;
};

// Hands one snapshot at a time from the cycle to the saving thread. `state_` is the only thing both touch at
// once.
class SaveMailbox {
  public:
    // Cycle: copies the snapshot in. False: the previous one is still being saved.
    bool offer(const ChangedParameters& snapshot) {
        if (state_.load(std::memory_order_acquire) != State::empty) {
            answers_.refused = !answers_.taken;
            return false;
        }
        answers_.taken = true;
        snapshot_ = snapshot;
        state_.store(State::full, std::memory_order_release);
        return true;
    }

    // Saving thread: the snapshot to save, or nullptr; finished() gives the slot back.
    const ChangedParameters* take() {
        return state_.load(std::memory_order_acquire) == State::full ? &snapshot_ : nullptr;
    }
    void finished(bool saved) {
        state_.store(saved ? State::saved : State::failed, std::memory_order_release);
    }

    enum class Outcome : std::uint8_t { none, saved, failed };
    // Cycle: the outcome of the last save, once.
    Outcome outcome() {
        const State state = state_.load(std::memory_order_acquire);
        if (state != State::saved && state != State::failed) return Outcome::none;
        state_.store(State::empty, std::memory_order_release);
        answers_.outcome = state == State::saved ? Outcome::saved : Outcome::failed;
        return answers_.outcome;
    }

    // What a cycle has been told, for the black box.
    struct Answers {
        bool taken = false;    // an offer
        bool refused = false;  // the first one
        Outcome outcome = Outcome::none;
    };
    // Cycle: since the last call.
    Answers answers() { return std::exchange(answers_, {}); }
    // Replay: the next cycle will be told this; where it is nothing, the next offer is taken.
    void pretend(const Answers& answers) {
        state_ = answers.outcome == Outcome::saved    ? State::saved
                 : answers.outcome == Outcome::failed ? State::failed
                 : answers.refused                    ? State::full
                                                      : State::empty;
    }

  private:
    enum class State : std::uint8_t { empty, full, saved, failed };
    std::atomic<State> state_{State::empty};
    ChangedParameters snapshot_;
    Answers answers_;
};

class ParameterService {
  public:
    using Result = protocol::ParameterResult;

    // `live` outlives the service; only commit() and record() write to it.
    ParameterService(model::RobotParameters& live, SaveMailbox& mailbox) : live_(live), mailbox_(mailbox) {}

    // Does what a request asks. `idle`: as for commit().
    protocol::ParameterReply answer(const protocol::ParameterRequest& request, bool idle);
    // How the last save ended, once.
    std::optional<protocol::ParameterReply> saved();

    Result read(std::uint16_t index, double& value) const;
    Result stage(std::uint16_t index, double value);
    // `idle`: the robot is in the idle mode. out_of_range: what is staged contradicts the rest, as a robot
    // file would be refused; it stays staged. On ok the live parameters have changed and changed() says so
    // once.
    Result commit(bool idle);
    Result discard();
    Result save();

    std::span<std::byte> memory() { return hal::plain_memory(staged_, *this); }

    // What the firmware itself found (identification): written to the live parameters and saved with the
    // rest.
    void record(std::uint16_t index, double value);

    // The live parameters changed since the last call.
    bool changed() {
        const bool was = changed_;
        changed_ = false;
        return was;
    }

  private:
    void remember(std::uint16_t index, double value);

    model::RobotParameters& live_;
    SaveMailbox& mailbox_;
    model::RobotParameters staged_;  // for trying; commit() begins anew from the live ones
    std::array<ChangedParameter, 64> staged_list_{};
    std::size_t staged_count_ = 0;
    bool staged_needs_idle_ = false;
    ChangedParameters since_load_;
    std::size_t offered_ = 0;  // how many parameters the last snapshot for the mailbox has
    bool changed_ = false;
};

}  // namespace wheelwright::task
