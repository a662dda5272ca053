// Random bytes that nobody can foretell, for challenges. Implementation: hal/linux (getrandom).
#pragma once

#include <cstdint>
#include <span>

namespace wheelwright::hal {

class RandomSource {
  public:
    virtual ~RandomSource() = default;

    // Fills all of `out` (at most 256 bytes); false: there is no entropy yet, ask again later. Called in a
    // cycle: neither allocates nor blocks.
    virtual bool fill(std::span<std::uint8_t> out) = 0;
};

}  // namespace wheelwright::hal
