// Random numbers of the trials: the same from a seed on every machine.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

namespace wheelwright::hidden {

// SplitMix64 (Steele, Lea, Flood 2014). Streams of one seed are independent.
class Random {
  public:
    explicit Random(std::uint64_t seed, std::uint64_t stream = 0)
        : state_(mixed(seed) ^ mixed(stream + 0x632BE59BD9B4E019U)) {}

    std::uint64_t bits() {
        state_ += 0x9E3779B97F4A7C15U;
        return mixed(state_);
    }

    // Evenly in [0, 1).
    double uniform() { return static_cast<double>(bits() >> 11U) * 0x1p-53; }
    double uniform(double low, double high) { return low + (high - low) * uniform(); }
    // Evenly in the logarithm; both ends positive.
    double log_uniform(double low, double high) { return low * std::pow(high / low, uniform()); }
    // 0 .. n - 1; n > 0.
    std::size_t below(std::size_t n) {
        return static_cast<std::size_t>(uniform() * static_cast<double>(n)) % n;
    }
    bool chance(double probability) { return uniform() < probability; }
    double sign() { return chance(0.5) ? 1 : -1; }

    // Mean 0, standard deviation 1 (Box and Muller).
    double gaussian() {
        const double radius = std::sqrt(-2 * std::log(1 - uniform()));
        return radius * std::cos(2 * std::numbers::pi * uniform());
    }

  private:
    static std::uint64_t mixed(std::uint64_t z) {
        z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
        z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
        return z ^ (z >> 31U);
    }

    std::uint64_t state_;
};

}  // namespace wheelwright::hidden
