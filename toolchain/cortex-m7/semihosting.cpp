#include "toolchain/cortex-m7/semihosting.hpp"

#include <array>
#include <cstring>

namespace {

constexpr std::uint32_t kOpen = 0x01;
constexpr std::uint32_t kWrite = 0x05;
constexpr std::uint32_t kWrite0 = 0x04;
constexpr std::uint32_t kExitExtended = 0x20;
constexpr std::uint32_t kApplicationExit = 0x20026;  // ADP_Stopped_ApplicationExit

std::uint32_t call(std::uint32_t operation, const void* argument) {
    std::uint32_t answer = 0;
    asm volatile(
        "mov r0, %1\n"
        "mov r1, %2\n"
        "bkpt 0xAB\n"
        "mov %0, r0\n"
        : "=r"(answer)
        : "r"(operation), "r"(argument)
        : "r0", "r1", "memory");
    return answer;
}

std::uint32_t word(const void* address) {
    return static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(address));
}

}  // namespace

namespace wheelwright::bare {

void write(const char* text) { static_cast<void>(call(kWrite0, text)); }

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

std::int32_t create(const char* name) {
    constexpr std::uint32_t kWriteBinary = 5;
    const std::array<std::uint32_t, 3> what = {word(name), kWriteBinary,
                                               static_cast<std::uint32_t>(std::strlen(name))};
    return static_cast<std::int32_t>(call(kOpen, what.data()));
}

bool append(std::int32_t file, const void* bytes, std::uint32_t count) {
    const std::array<std::uint32_t, 3> what = {static_cast<std::uint32_t>(file), word(bytes), count};
    return call(kWrite, what.data()) == 0;  // bytes that were not written
}

}  // namespace wheelwright::bare

void leave(int status) {
    const std::array<std::uint32_t, 2> reason = {kApplicationExit, static_cast<std::uint32_t>(status)};
    static_cast<void>(call(kExitExtended, reason.data()));
    for (;;) {
    }
}
