#include "toolchain/cortex-m7/semihosting.hpp"

#include <array>

namespace {

constexpr std::uint32_t kWrite0 = 0x04;
constexpr std::uint32_t kExitExtended = 0x20;
constexpr std::uint32_t kApplicationExit = 0x20026;  // ADP_Stopped_ApplicationExit

void call(std::uint32_t operation, const void* argument) {
    asm volatile(
        "mov r0, %0\n"
        "mov r1, %1\n"
        "bkpt 0xAB\n"
        :
        : "r"(operation), "r"(argument)
        : "r0", "r1", "memory");
}

}  // namespace

namespace wheelwright::bare {

void write(const char* text) { call(kWrite0, text); }

void write(std::int32_t value) {
    std::array<char, 12> text{};
    auto digit = text.end() - 1;
    std::uint32_t rest =
        value < 0 ? 0U - static_cast<std::uint32_t>(value) : static_cast<std::uint32_t>(value);
    do {
        *--digit = static_cast<char>('0' + rest % 10U);
        rest /= 10U;
    } while (rest != 0);
    if (value < 0) *--digit = '-';
    write(&*digit);
}

}  // namespace wheelwright::bare

void leave(int status) {
    const std::array<std::uint32_t, 2> reason = {kApplicationExit, static_cast<std::uint32_t>(status)};
    call(kExitExtended, reason.data());
    for (;;) {
    }
}
