// From reset to run() on a bare Cortex-M7: FPU on, .data copied, .bss cleared, constructors run.
#include <cstddef>
#include <cstdint>

extern "C" {
extern std::uint32_t stack_top;
extern const std::uint32_t data_image;
extern std::uint32_t data_begin;
extern std::uint32_t data_end;
extern std::uint32_t bss_begin;
extern std::uint32_t bss_end;
using Constructor = void (*)();
extern const Constructor init_array_begin;
extern const Constructor init_array_end;

int run();                            // the program; ISO C++ lets nobody call main()
[[noreturn]] void leave(int status);  // the board's way out; see semihosting.cpp
[[noreturn]] void reset();
[[noreturn]] void fault();
[[gnu::weak]] void systick();  // where a program has one
}

namespace {

constexpr std::uintptr_t kCoprocessorAccess = 0xE000ED88;              // CPACR, ARMv7-M B3.2.20
constexpr std::uint32_t kFullAccessToFpu = std::uint32_t{0xF} << 20U;  // CP10 and CP11

}  // namespace

void reset() {
    // Before anything that could use a floating-point register.
    *reinterpret_cast<volatile std::uint32_t*>(kCoprocessorAccess) |= kFullAccessToFpu;
    asm volatile("dsb\n isb" ::: "memory");

    const std::uint32_t* from = &data_image;
    for (std::uint32_t* to = &data_begin; to < &data_end;) *to++ = *from++;
    for (std::uint32_t* to = &bss_begin; to < &bss_end;) *to++ = 0;
    for (const Constructor* construct = &init_array_begin; construct < &init_array_end; ++construct) {
        (*construct)();
    }
    leave(run());
}

void fault() { leave(125); }
void systick() { fault(); }

// Virtual destructors and abstract classes refer to these, and nobody calls them: there is no heap.
void operator delete(void*) noexcept { fault(); }
void operator delete(void*, std::size_t) noexcept { fault(); }
extern "C" void __cxa_pure_virtual() { fault(); }

namespace {

using Handler = void (*)();
struct Vectors {
    std::uint32_t* initial_stack;
    Handler reset;
    Handler exceptions[14];  // NMI, faults, SVCall, PendSV: none is expected; SysTick
};

[[gnu::section(".vectors"), gnu::used]] const Vectors vectors = {
    &stack_top,
    reset,
    {fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, systick},
};

}  // namespace
