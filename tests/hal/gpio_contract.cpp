// The digital line contract on a chip of this machine, for a person or for a test in a virtual machine:
//     gpio_contract CHIP INPUT OUTPUT [SECONDS]
// or WHEELWRIGHT_GPIO="CHIP INPUT OUTPUT [SECONDS]". CHIP is such as gpiochip0; INPUT and OUTPUT are line
// numbers. The wires need not be connected. With SECONDS it then copies the input to the output once a
// millisecond and prints each change, so that whoever drives the input sees it come out. Exit status: 0 the
// contract holds, 1 usage, 3 it does not hold, 4 the lines cannot be opened.
#define WHEELWRIGHT_CONTRACT_PLAIN

#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>

#include "hal/linux/gpiod_line.hpp"
#include "hal/linux/monotonic_clock.hpp"
#include "tests/contract/digital_line_contract.hpp"

using namespace wheelwright;

namespace {

struct Rig {
    hal::DigitalInput& in;
    hal::DigitalOutput& out;

    hal::DigitalInput& input() { return in; }
    hal::DigitalOutput& output() { return out; }
    bool drive_input(bool /*active*/) { return false; }
    hal::LineLevel output_level() { return hal::LineLevel::unknown; }
};

void copy_changes(Rig rig, double seconds) {
    hal::MonotonicClock clock;
    const std::int64_t start_ns = clock.now_ns();
    hal::LineLevel last = hal::LineLevel::unknown;
    for (std::int64_t tick_ns = start_ns; tick_ns < start_ns + static_cast<std::int64_t>(seconds * 1e9);
         tick_ns += 1'000'000) {
        clock.sleep_until_ns(tick_ns);
        const hal::LineLevel level = rig.in.read();
        if (level != last) {
            rig.out.write(level == hal::LineLevel::active);
            std::printf("input %s at %.3f s\n", level == hal::LineLevel::active ? "active" : "inactive",
                        static_cast<double>(clock.now_ns() - start_ns) / 1e9);
            std::fflush(stdout);
            last = level;
        }
    }
}

}  // namespace

int main(int argc, char** argv) {
    std::string words;
    for (int i = 1; i < argc; ++i) {
        words += std::string(argv[i]) + " ";
    }
    const char* from_environment = std::getenv("WHEELWRIGHT_GPIO");
    if (argc == 1 && from_environment != nullptr) {
        words = from_environment;
    }
    std::istringstream arguments(words);
    hal::LineOptions input_options;
    hal::LineOptions output_options;
    if (!(arguments >> input_options.chip >> input_options.offset >> output_options.offset)) {
        std::fprintf(stderr, "usage: gpio_contract CHIP INPUT OUTPUT [SECONDS]\n");
        return 1;
    }
    output_options.chip = input_options.chip;
    double seconds = 0;
    arguments >> seconds;

    auto input = hal::open_input(input_options);
    auto output = hal::open_output(output_options);
    for (const auto* error : {input ? nullptr : &input.error(), output ? nullptr : &output.error()}) {
        if (error != nullptr) {
            std::fprintf(stderr, "%s\n", error->message.c_str());
            return error->exit_status();
        }
    }
    Rig rig{*input.value(), *output.value()};
#define RUN(name)               \
    std::printf("%s\n", #name); \
    contract::name(rig);
    WHEELWRIGHT_DIGITAL_LINE_CONTRACT(RUN)
    std::printf("a_line_in_use_is_refused\n");
    const auto again = hal::open_input(input_options);
    EXPECT_THAT(!again);
    if (!again) {
        std::printf("    %s\n", again.error().message.c_str());
    }
    std::printf("%d expectations failed\n", contract::failures);
    std::fflush(stdout);
    copy_changes(rig, seconds);
    return contract::failures == 0 ? 0 : 3;
}
