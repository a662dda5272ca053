// Pseudo-random binary sequences of maximal length, from linear feedback shift registers.
//
// Two wheels need two registers of different length: shifts of one sequence multiply into a shift of
// themselves, so products of the two would be correlated with each of them.
#pragma once

#include <array>
#include <cstdint>

namespace wheelwright::ident {

// x^length + x^tap + 1, primitive over GF(2) for each entry; period 2^length - 1 bits.
struct PrbsRegister {
    unsigned length;
    unsigned tap;
};

inline constexpr PrbsRegister kPrbsLeft{29, 27};
inline constexpr PrbsRegister kPrbsRight{31, 28};

class Prbs {
  public:
    // Any seed is good, 0 too. samples_per_bit >= 1: how often a bit is repeated.
    constexpr Prbs(PrbsRegister shift_register, std::uint32_t seed, unsigned samples_per_bit)
        : register_(shift_register), samples_per_bit_(samples_per_bit) {
        restart(seed);
    }

    constexpr void restart(std::uint32_t seed) {
        // scattered, so that small seeds do not begin with long runs
        std::uint32_t x = seed + 0x9e3779b9U;
        x = (x ^ (x >> 16)) * 0x85ebca6bU;
        x = (x ^ (x >> 13)) * 0xc2b2ae35U;
        x ^= x >> 16;
        state_ = x & mask();
        if (state_ == 0) state_ = 1;
        phase_ = 0;
    }

    // The next sample: +1 or -1.
    constexpr int next() {
        if (phase_ == 0) shift();
        if (++phase_ >= samples_per_bit_) phase_ = 0;
        return (state_ & 1U) != 0 ? 1 : -1;
    }

    constexpr std::uint32_t state() const { return state_; }

  private:
    constexpr std::uint32_t mask() const { return 0xffffffffU >> (32 - register_.length); }
    constexpr void shift() {
        const std::uint32_t bit = ((state_ >> (register_.length - 1)) ^ (state_ >> (register_.tap - 1))) & 1U;
        state_ = ((state_ << 1) | bit) & mask();
    }

    PrbsRegister register_;
    unsigned samples_per_bit_;
    unsigned phase_ = 0;
    std::uint32_t state_ = 1;
};

}  // namespace wheelwright::ident
