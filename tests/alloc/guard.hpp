// Forbids memory management, throwing, locking and waiting while it is armed: this binary's own versions of
// those functions stand before the library's (guard.cpp). Where the kernel can divert system calls
// (Linux 5.11, x86-64) every one of them is forbidden too. One thread.
#pragma once

namespace wheelwright::guard {

// The process ends with this status when something forbidden happens; standard error then says what and
// where.
inline constexpr int kBitten = 97;

// Call once. False: system calls cannot be diverted here, so only the functions are watched.
bool prepare();

// What is going on, for the message; the text must live on.
void set_scene(const char* text);

void arm();
void disarm();

class Armed {
  public:
    Armed() { arm(); }
    ~Armed() { disarm(); }
    Armed(const Armed&) = delete;
    Armed& operator=(const Armed&) = delete;
};

}  // namespace wheelwright::guard
