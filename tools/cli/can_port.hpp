// What the commands that talk to a bus share: opening it with useful errors, waiting for frames, Ctrl-C.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "hal/linux/socketcan_bus.hpp"

namespace wheelwright::tools {

// Opens a SocketCAN interface. On failure returns nothing, says why and what to do on standard error, and
// sets the exit status.
std::unique_ptr<hal::SocketCanBus> open_can(const std::string& interface, int& exit_status);

// The clock of the received frames' timestamps, and what to add to them for wall-clock time.
std::int64_t can_now_ns();
std::int64_t wall_clock_offset_ns();

// Sends, waiting up to 50 ms for room in the queue. Returns "" or one sentence.
std::string send_frame(hal::CanBus& bus, const hal::CanFrame& frame);

// Waits for the next frame until `deadline_ns` on can_now_ns(). False: none came, or Ctrl-C.
bool receive_until(hal::SocketCanBus& bus, hal::ReceivedFrame& out, std::int64_t deadline_ns);

// From the first call of catch_interrupt() on, Ctrl-C and SIGTERM end waiting instead of the program.
void catch_interrupt();
bool interrupted();
// From here on it counts anew: what Ctrl-C has ended is being brought to an end in order.
void forget_interrupt();

// Sleeps until `deadline_ns` or Ctrl-C.
void sleep_until(std::int64_t deadline_ns);

}  // namespace wheelwright::tools
