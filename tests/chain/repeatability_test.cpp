// "The same seed gives the same bytes twice."
#include <cstdint>
#include <cstdio>

#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(ChainRepeatability){};

namespace {

// FNV-1a over each frame on the wire with its time.
class Fingerprint final : public sim::BusTap {
  public:
    void on_frame(const sim::WireEvent& event) override {
        add(event.frame->id);
        add(static_cast<std::uint64_t>(event.end_ns));
        for (std::size_t i = 0; i < event.frame->length; ++i) add(event.frame->data[i]);
        ++frames;
    }
    std::uint64_t value = 0xcbf29ce484222325U;
    std::uint64_t frames = 0;

  private:
    void add(std::uint64_t word) { value = (value ^ word) * 0x100000001b3U; }
};

Fingerprint fingerprint(std::uint64_t seed) {
    Simulation sim(chain::believed().parameters, chain::real().parameters, chain::options(seed));
    Fingerprint print;
    sim.bus().add_tap(print);
    sim.run_for(0.5);
    identify(sim);
    velocity_step(sim, {0.2, 0.3});
    sim.bus().catch_up();
    return print;
}

}  // namespace

TEST(ChainRepeatability, the_same_seed_gives_the_same_frames_at_the_same_times) {
    const Fingerprint first = fingerprint(42);
    const Fingerprint second = fingerprint(42);
    const Fingerprint other = fingerprint(43);
    std::printf("%llu frames, fingerprint %016llx\n", static_cast<unsigned long long>(first.frames),
                static_cast<unsigned long long>(first.value));
    CHECK(first.frames > 10'000);
    CHECK(first.value == second.value);
    CHECK(first.value != other.value);
}
