// The kernel's random source, for who may call the system; a cycle does not: make_random() in
// cryptography.hpp.
#pragma once

#include "hal/random_source.hpp"

namespace wheelwright::hal {

// Threads: any.
class SystemRandom final : public RandomSource {
  public:
    bool fill(std::span<std::uint8_t> out) override;
};

}  // namespace wheelwright::hal
