// The contract suites on every implementation that needs no device.
#include "hal/linux/monotonic_clock.hpp"
#include "sim_hal/sim_line.hpp"
#include "tests/contract/can_bus_contract.hpp"
#include "tests/contract/clock_contract.hpp"
#include "tests/contract/digital_line_contract.hpp"
#include "tests/hal/in_process_rig.hpp"

using namespace wheelwright;

namespace {

class FdRig : public InProcessRig {
  public:
    FdRig() : InProcessRig(options()) {}

  private:
    static sim::InProcessBusOptions options() {
        sim::InProcessBusOptions options;
        options.fd = true;
        options.stuffing = sim::Stuffing::random_data;
        options.bit_rate = 500'000;
        return options;
    }
};

// Every twelfth frame is destroyed on the wire and repeated, and each takes its own time to the receiver.
class DisturbedRig : public InProcessRig {
  public:
    DisturbedRig() : InProcessRig(options()) {
        sim::FaultRule rule;
        rule.action = sim::FaultAction::destroy;
        rule.probability = 0.08;  // more would end bus-off: 8 up for each, 1 down for each success
        wire().add_fault(rule);
    }

  private:
    static sim::InProcessBusOptions options() {
        sim::InProcessBusOptions options;
        options.receive_latency_ns = 30'000;
        options.receive_jitter_ns = 200'000;
        options.receive_capacity = 300;
        options.transmit_capacity = 24;
        options.seed = 7;
        return options;
    }
};

class VirtualClockRig {
  public:
    hal::Clock& clock() { return clock_; }

  private:
    sim::VirtualClock clock_{77};
};

class MonotonicClockRig {
  public:
    hal::Clock& clock() { return clock_; }

  private:
    hal::MonotonicClock clock_;
};

class SimLineRig {
  public:
    hal::DigitalInput& input() { return input_; }
    hal::DigitalOutput& output() { return output_; }
    bool drive_input(bool active) {
        input_.set(active ? hal::LineLevel::active : hal::LineLevel::inactive);
        return true;
    }
    hal::LineLevel output_level() { return output_.level(); }

  private:
    sim::VirtualClock clock_;
    sim::SimInput input_{clock_};
    sim::SimOutput output_{clock_};
};

}  // namespace

TEST_GROUP(InProcessBusContract){};
#define ON_IN_PROCESS(name)            \
    TEST(InProcessBusContract, name) { \
        InProcessRig rig;              \
        contract::name(rig);           \
    }
WHEELWRIGHT_CAN_BUS_CONTRACT(ON_IN_PROCESS)

TEST_GROUP(DisturbedBusContract){};
#define ON_DISTURBED(name)             \
    TEST(DisturbedBusContract, name) { \
        DisturbedRig rig;              \
        contract::name(rig);           \
    }
WHEELWRIGHT_CAN_BUS_CONTRACT(ON_DISTURBED)

TEST_GROUP(FdBusContract){};
#define ON_FD(name)             \
    TEST(FdBusContract, name) { \
        FdRig rig;              \
        contract::name(rig);    \
    }
WHEELWRIGHT_CAN_BUS_CONTRACT(ON_FD)

TEST_GROUP(VirtualClockContract){};
#define ON_VIRTUAL_CLOCK(name)         \
    TEST(VirtualClockContract, name) { \
        VirtualClockRig rig;           \
        contract::name(rig);           \
    }
WHEELWRIGHT_CLOCK_CONTRACT(ON_VIRTUAL_CLOCK)

TEST_GROUP(MonotonicClockContract){};
#define ON_MONOTONIC_CLOCK(name)         \
    TEST(MonotonicClockContract, name) { \
        MonotonicClockRig rig;           \
        contract::name(rig);             \
    }
WHEELWRIGHT_CLOCK_CONTRACT(ON_MONOTONIC_CLOCK)

TEST_GROUP(SimLineContract){};
#define ON_SIM_LINE(name)         \
    TEST(SimLineContract, name) { \
        SimLineRig rig;           \
        contract::name(rig);      \
    }
WHEELWRIGHT_DIGITAL_LINE_CONTRACT(ON_SIM_LINE)
