// Random numbers of the simulation. Integer arithmetic up to one final multiplication, so a seed gives the
// same numbers on every machine and with every standard library.
#pragma once

#include <cstdint>

namespace wheelwright::sim {

// xoshiro256++ (Blackman and Vigna, 2019), its state filled from the seed by splitmix64.
class Random {
  public:
    // Different streams of one seed are independent.
    explicit Random(std::uint64_t seed, std::uint64_t stream = 0) {
        std::uint64_t x = seed ^ (stream * 0xD1B54A32D192ED03U);
        for (std::uint64_t& word : state_) {
            x += 0x9E3779B97F4A7C15U;
            std::uint64_t z = x;
            z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
            z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
            word = z ^ (z >> 31U);
        }
    }

    std::uint64_t bits() {
        const std::uint64_t result = rotate(state_[0] + state_[3], 23) + state_[0];
        const std::uint64_t shifted = state_[1] << 17U;
        state_[2] ^= state_[0];
        state_[3] ^= state_[1];
        state_[1] ^= state_[2];
        state_[0] ^= state_[3];
        state_[2] ^= shifted;
        state_[3] = rotate(state_[3], 45);
        return result;
    }

    // Evenly in [0, 1).
    double uniform() { return static_cast<double>(bits() >> 11U) * 0x1p-53; }

    // Mean 0, standard deviation 1: the sum of twelve 16-bit uniform numbers (Irwin-Hall). Kurtosis 2.9,
    // never beyond +-6. Three draws.
    double gaussian() {
        const std::int32_t sum = four(bits()) + four(bits()) + four(bits());
        return (sum - 6 * kFullScale) * kTwelve;
    }

    // The same from four uniform numbers: kurtosis 2.7, never beyond +-3.46. One draw.
    double gaussian_fast() { return (four(bits()) - 2 * kFullScale) * kFour; }

  private:
    static constexpr std::int32_t kFullScale = 0xFFFF;
    // A uniform integer of 0..65535 has the variance (65536^2 - 1) / 12.
    static constexpr double kTwelve = 1.5258789064276357e-05;  // 1 / sqrt(65536^2 - 1)
    static constexpr double kFour = 2.6428997921303018e-05;    // sqrt(3 / (65536^2 - 1))

    static std::uint64_t rotate(std::uint64_t x, unsigned by) { return (x << by) | (x >> (64U - by)); }
    static std::int32_t four(std::uint64_t x) {
        return static_cast<std::int32_t>((x & 0xFFFFU) + ((x >> 16U) & 0xFFFFU) + ((x >> 32U) & 0xFFFFU) +
                                         (x >> 48U));
    }

    std::uint64_t state_[4];  // NOLINT(*-avoid-c-arrays)
};

}  // namespace wheelwright::sim
