// Text and exit status through Arm semihosting, which QEMU and debug probes answer (Arm "Semihosting for
// AArch32 and AArch64"). No allocation; each call stops the processor until the host has answered.
#pragma once

#include <cstdint>

namespace wheelwright::bare {

void write(const char* text);  // zero-terminated
void write(std::int32_t value);

// A file of the host's, in the folder in which it was started. Open: written anew. Handles are the host's.
std::int32_t create(const char* name);  // -1: it cannot be
bool append(std::int32_t file, const void* bytes, std::uint32_t count);

}  // namespace wheelwright::bare

// Ends the program with an exit status that reaches the host's shell.
extern "C" [[noreturn]] void leave(int status);
