// User-mode Linux 6.1 on processors whose registers are more than it knows of. It keeps the floating-point
// registers of its processes in 2696 bytes, as much as AVX-512 needs, and gives as many back; a machine with
// AMX has 11 kB of them and takes all or none, so the first process in there dies. Preloaded into linux.uml,
// this adds what is missing: what the process has in the others already.
#include <dlfcn.h>
#include <elf.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstddef>
#include <cstdint>

extern "C" long ptrace(__ptrace_request request, ...) noexcept {
    using Original = long (*)(__ptrace_request, pid_t, void*, void*);
    static const auto original = reinterpret_cast<Original>(dlsym(RTLD_NEXT, "ptrace"));
    va_list arguments;
    va_start(arguments, request);  // NOLINT(clang-diagnostic-varargs): the C library declares it so
    const pid_t process = va_arg(arguments, pid_t);
    void* const address = va_arg(arguments, void*);
    void* const data = va_arg(arguments, void*);
    va_end(arguments);
    const long result = original(request, process, address, data);
    const bool registers = reinterpret_cast<std::uintptr_t>(address) == NT_X86_XSTATE;
    if (result >= 0 || request != PTRACE_SETREGSET || !registers) return result;
    static std::array<std::byte, 65536> all;  // linux.uml has one thread
    iovec whole{all.data(), all.size()};
    if (original(PTRACE_GETREGSET, process, address, &whole) < 0) return -1;
    const auto* known = static_cast<const iovec*>(data);
    std::copy_n(static_cast<const std::byte*>(known->iov_base), std::min(known->iov_len, whole.iov_len),
                all.data());
    return original(PTRACE_SETREGSET, process, address, &whole);
}
