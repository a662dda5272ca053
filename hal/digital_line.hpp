// Digital lines: the emergency-stop input and the drive-enable output. Implementations: hal/linux (libgpiod),
// sim_hal. Levels are logical (active-low wiring is the implementation's matter).
#pragma once

#include <cstdint>

namespace wheelwright::hal {

enum class LineLevel : std::uint8_t {
    inactive,
    active,
    unknown,  // the line could not be read; treat it as the unsafe level
};

class DigitalInput {
  public:
    virtual ~DigitalInput() = default;
    virtual LineLevel read() = 0;  // does not block
};

class DigitalOutput {
  public:
    virtual ~DigitalOutput() = default;
    virtual bool write(bool active) = 0;  // false: the line could not be driven
};

}  // namespace wheelwright::hal
