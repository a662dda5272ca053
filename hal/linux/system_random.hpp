// The kernel's random source.
#pragma once

#include "hal/random_source.hpp"

namespace wheelwright::hal {

// Threads: any.
class SystemRandom final : public RandomSource {
  public:
    bool fill(std::span<std::uint8_t> out) override;
};

}  // namespace wheelwright::hal
