// Text and exit status through Arm semihosting, which QEMU and debug probes answer (Arm "Semihosting for
// AArch32 and AArch64"). No allocation; each call stops the processor until the host has answered.
#pragma once

#include <cstdint>

namespace wheelwright::bare {

void write(const char* text);  // zero-terminated
void write(std::int32_t value);

}  // namespace wheelwright::bare

// Ends the program with an exit status that reaches the host's shell.
extern "C" [[noreturn]] void leave(int status);
