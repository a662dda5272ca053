// Digital lines through libgpiod. Opening may allocate; read() and write() are one ioctl and do neither
// allocate nor throw. Threads: one for each line.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "hal/digital_line.hpp"
#include "hal/linux/result.hpp"

namespace wheelwright::hal {

enum class LineBias : std::uint8_t { as_is, disabled, pull_up, pull_down };

struct LineOptions {
    std::string chip = "gpiochip0";  // a name in /dev, or a path
    unsigned offset = 0;             // of the line in the chip
    bool active_low = false;         // the wire is low when the line is active
    LineBias bias = LineBias::as_is;
    std::string consumer = "wheelwright";  // what `gpioinfo` shows as the user of the line
    bool initially_active = false;         // outputs: what is driven from the moment of opening
};

// Errors: no such chip or line, no permission, the line is used by somebody else, built without libgpiod.
Result<std::unique_ptr<DigitalInput>> open_input(const LineOptions& options);

// The line is released when the object goes; whether it then keeps its level is the chip's matter.
Result<std::unique_ptr<DigitalOutput>> open_output(const LineOptions& options);

}  // namespace wheelwright::hal
