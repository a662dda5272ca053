// How full a bus is, from the frames that the firmware sends and receives, at their worst-case length.
#pragma once

#include <cstdint>

#include "firmware/protocol/bus_load.hpp"
#include "hal/can_bus.hpp"

namespace wheelwright::task {

class BusMeter {
  public:
    explicit BusMeter(double bit_rate_bit_per_s) : bit_rate_bit_per_s_(bit_rate_bit_per_s) {}

    void count(const hal::CanFrame& frame) {
        if (!frame.error && !frame.fd) {
            bits_ += protocol::worst_case_bits(frame.length, frame.extended);
        }
    }

    // Once in each cycle; the load is renewed every kWindowCycles.
    void step(double cycle_s) {
        if (++cycles_ < kWindowCycles) return;
        load_ = bits_ / (bit_rate_bit_per_s_ * cycle_s * cycles_);
        cycles_ = 0;
        bits_ = 0;
    }

    double load() const { return load_; }  // 1: full

  private:
    static constexpr int kWindowCycles = 200;

    double bit_rate_bit_per_s_;
    double load_ = 0;
    int bits_ = 0;
    int cycles_ = 0;
};

}  // namespace wheelwright::task
