// What the firmware asks of a CAN bus. Implementations: hal/linux (SocketCAN), sim_hal (in-process).
// One contract suite, tests/contract/can_bus_contract.hpp, runs on all of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace wheelwright::hal {

// One CAN frame, classic or FD.
struct CanFrame {
    std::uint32_t id = 0;          // 11-bit, or 29-bit when `extended`
    std::uint8_t length = 0;       // data bytes: 0..8 classic; 0..8, 12, 16, 20, 24, 32, 48, 64 FD
    bool extended = false;         // 29-bit identifier
    bool remote = false;           // remote transmission request; carries no data
    bool fd = false;               // CAN FD format
    bool bit_rate_switch = false;  // FD only: data phase at the faster rate
    bool error = false;  // received only: an error frame; `id` then holds the kernel's error class bits
    std::array<std::uint8_t, 64> data;  // bytes past `length` are indeterminate
};

// Whether a bus can send the frame: identifier within its format, a length that the format has, no error
// frame; FD frames on an FD bus only. send() says `invalid` exactly when this is false.
constexpr bool is_sendable(const CanFrame& frame, bool fd_bus) {
    if (frame.error || frame.id > (frame.extended ? 0x1FFF'FFFFU : 0x7FFU)) {
        return false;
    }
    if (!frame.fd) {
        return frame.length <= 8 && !frame.bit_rate_switch;
    }
    const std::uint8_t n = frame.length;
    const bool fd_length =
        n <= 8 || n == 12 || n == 16 || n == 20 || n == 24 || n == 32 || n == 48 || n == 64;
    return fd_bus && fd_length && !frame.remote;
}

struct ReceivedFrame {
    CanFrame frame;
    std::int64_t timestamp_ns = 0;  // when the frame was on the wire, in the time base of the bus's Clock
};

// Accepts a frame when (frame.id & mask) == (id & mask) and `extended` is equal. Remote frames are judged
// like data frames, so who reads an identifier that others may request checks CanFrame::remote.
struct CanFilter {
    std::uint32_t id = 0;
    std::uint32_t mask = 0;
    bool extended = false;
};

enum class CanStatus : std::uint8_t {
    ok,
    would_block,  // send: the transmit queue is full; receive: nothing is waiting
    invalid,      // the frame cannot be sent on this bus (length, identifier, FD on a classic bus)
    bus_down,     // the interface is down or gone, or the controller is bus-off; receive: and nothing waits
};

// Monotonic counters; none is ever reset.
struct CanStatistics {
    std::uint64_t frames_sent = 0;
    std::uint64_t frames_received = 0;   // error frames are not counted here
    std::uint64_t send_refused = 0;      // each send() that did not return ok
    std::uint64_t receive_overflow = 0;  // lost because the receive queue was full: the newest; known at the
                                         // latest when the next frame is received
    std::uint64_t error_frames = 0;
    std::uint64_t bus_off = 0;
};

// Threads: one thread calls send, receive and statistics; set_filters before that thread starts cycling.
// None of these calls blocks, allocates or throws.
class CanBus {
  public:
    virtual ~CanBus() = default;

    // Queues one frame for transmission. The frame is copied.
    virtual CanStatus send(const CanFrame& frame) = 0;

    // Whether a frame with this (11-bit, classic) identifier that send() has taken has not been on the wire
    // yet, as far as the last receive() knows. Frames leave in the order of send(), so who sends no other
    // frame of an identifier that still waits has one old frame of it in the queue at most, however long the
    // bus is jammed. False where the machine cannot tell.
    virtual bool waits(std::uint32_t id) const = 0;

    // Takes the oldest waiting frame. Own frames are never received. Returns would_block when none waits, or
    // none did at the last look into the machine's queue; the next call looks anew.
    virtual CanStatus receive(ReceivedFrame& out) = 0;

    // Replaces the set of accepted frames; an empty set accepts nothing but error frames, and a new bus
    // accepts everything. Frames that wait already stay. Every implementation holds 32 filters. False: it
    // cannot hold that many, and the old set stays.
    virtual bool set_filters(std::span<const CanFilter> filters) = 0;

    virtual CanStatistics statistics() const = 0;
};

}  // namespace wheelwright::hal
