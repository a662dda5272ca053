// Random bytes that nobody can foretell, for challenges and keys. Implementations: hal/linux.
#pragma once

#include <cstdint>
#include <span>

namespace wheelwright::hal {

class RandomSource {
  public:
    virtual ~RandomSource() = default;

    // Fills all of `out` (at most 256 bytes); false: there are none yet, ask again later.
    virtual bool fill(std::span<std::uint8_t> out) = 0;
};

}  // namespace wheelwright::hal
