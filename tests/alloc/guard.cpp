#include "tests/alloc/guard.hpp"

#include <cxxabi.h>
#include <dlfcn.h>
#include <execinfo.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/prctl.h>
#include <threads.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <typeinfo>

// What the allocator is called inside glibc.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* memory);
}

namespace wheelwright::guard {
namespace {

#ifdef PR_SET_SYSCALL_USER_DISPATCH
constexpr char kAllow = SYSCALL_DISPATCH_FILTER_ALLOW;
constexpr char kBlock = SYSCALL_DISPATCH_FILTER_BLOCK;
#else
constexpr char kAllow = 0;
constexpr char kBlock = 1;
#endif

volatile bool armed = false;
volatile char system_calls = kAllow;  // read by the kernel
const char* scene = "";

void say(const char* text) {
    if (::write(STDERR_FILENO, text, std::strlen(text)) < 0) return;
}

[[noreturn]] void bite(const char* what) {
    system_calls = kAllow;
    armed = false;
    say(what);
    say(" inside a cycle: ");
    say(scene);
    say("\n");
    std::array<void*, 48> frames{};
    backtrace_symbols_fd(frames.data(), backtrace(frames.data(), frames.size()), STDERR_FILENO);
    _exit(kBitten);
}

void on_system_call(int, siginfo_t* info, void*) {
    system_calls = kAllow;
    std::array<char, 32> text{"system call 000"};
    int number = info->si_syscall;
    for (std::size_t i = 14; i >= 12; --i, number /= 10) text[i] = static_cast<char>('0' + number % 10);
    bite(text.data());
}

}  // namespace

bool prepare() {
    // backtrace() loads a library the first time.
    std::array<void*, 2> frames{};
    backtrace(frames.data(), frames.size());
#if defined(PR_SET_SYSCALL_USER_DISPATCH) && defined(__x86_64__)
    struct sigaction action {};
    action.sa_sigaction = on_system_call;
    action.sa_flags = SA_SIGINFO;
    sigaction(SIGSYS, &action, nullptr);
    return prctl(PR_SET_SYSCALL_USER_DISPATCH, PR_SYS_DISPATCH_ON, 0L, 0L, &system_calls) == 0;
#else
    static_cast<void>(on_system_call);
    return false;
#endif
}

void set_scene(const char* text) { scene = text; }

void arm() {
    armed = true;
    system_calls = kBlock;
}

void disarm() {
    system_calls = kAllow;
    armed = false;
}

namespace {

void forbid(const char* what) {
    if (armed) bite(what);
}

// The library's function of that name. dlsym's result is an object pointer by the language, a function by
// POSIX.
template <typename Function>
Function* next(const char* name) {
    void* found = dlsym(RTLD_NEXT, name);
    Function* function = nullptr;
    static_assert(sizeof function == sizeof found);
    std::memcpy(&function, &found, sizeof found);
    return function;
}

}  // namespace
}  // namespace wheelwright::guard

using wheelwright::guard::forbid;
using wheelwright::guard::next;

extern "C" {

// --- memory ----------------------------------------------------------------------------------------------

void* malloc(std::size_t size) {
    forbid("malloc");
    return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
    forbid("calloc");
    return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
    forbid("realloc");
    return __libc_realloc(memory, size);
}
void* reallocarray(void* memory, std::size_t count, std::size_t size) {
    forbid("reallocarray");
    std::size_t bytes = 0;
    if (__builtin_mul_overflow(count, size, &bytes)) return nullptr;
    return __libc_realloc(memory, bytes);
}
void free(void* memory) {
    forbid("free");
    __libc_free(memory);
}
void* memalign(std::size_t alignment, std::size_t size) {
    forbid("memalign");
    return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
    forbid("aligned_alloc");
    return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
    forbid("posix_memalign");
    *memory = __libc_memalign(alignment, size);
    return *memory == nullptr ? ENOMEM : 0;
}
void* valloc(std::size_t size) {
    forbid("valloc");
    return __libc_memalign(4096, size);
}
void* pvalloc(std::size_t size) {
    forbid("pvalloc");
    return __libc_memalign(4096, (size + 4095) & ~std::size_t{4095});
}

// --- exceptions, and objects made at their first use -----------------------------------------------------

void* __cxa_allocate_exception(std::size_t size) noexcept {
    forbid("__cxa_allocate_exception");
    return next<void*(std::size_t)>("__cxa_allocate_exception")(size);
}
void __cxa_throw(void* object, std::type_info* type, void (*destroy)(void*)) {
    forbid("__cxa_throw");
    next<void(void*, std::type_info*, void (*)(void*))>("__cxa_throw")(object, type, destroy);
    __builtin_unreachable();
}
void __cxa_rethrow() {
    forbid("__cxa_rethrow");
    next<void()>("__cxa_rethrow")();
    __builtin_unreachable();
}
int __cxa_guard_acquire(__cxxabiv1::__guard* guard) {
    forbid("__cxa_guard_acquire");
    return next<int(__cxxabiv1::__guard*)>("__cxa_guard_acquire")(guard);
}

// --- locks -----------------------------------------------------------------------------------------------

int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
    forbid("pthread_mutex_lock");
    return next<int(pthread_mutex_t*)>("pthread_mutex_lock")(mutex);
}
int pthread_mutex_trylock(pthread_mutex_t* mutex) noexcept {
    forbid("pthread_mutex_trylock");
    return next<int(pthread_mutex_t*)>("pthread_mutex_trylock")(mutex);
}
int pthread_mutex_timedlock(pthread_mutex_t* mutex, const timespec* until) noexcept {
    forbid("pthread_mutex_timedlock");
    return next<int(pthread_mutex_t*, const timespec*)>("pthread_mutex_timedlock")(mutex, until);
}
int pthread_mutex_clocklock(pthread_mutex_t* mutex, clockid_t clock, const timespec* until) noexcept {
    forbid("pthread_mutex_clocklock");
    return next<int(pthread_mutex_t*, clockid_t, const timespec*)>("pthread_mutex_clocklock")(mutex, clock,
                                                                                              until);
}
int pthread_mutex_unlock(pthread_mutex_t* mutex) noexcept {
    forbid("pthread_mutex_unlock");
    return next<int(pthread_mutex_t*)>("pthread_mutex_unlock")(mutex);
}
int pthread_rwlock_rdlock(pthread_rwlock_t* lock) noexcept {
    forbid("pthread_rwlock_rdlock");
    return next<int(pthread_rwlock_t*)>("pthread_rwlock_rdlock")(lock);
}
int pthread_rwlock_wrlock(pthread_rwlock_t* lock) noexcept {
    forbid("pthread_rwlock_wrlock");
    return next<int(pthread_rwlock_t*)>("pthread_rwlock_wrlock")(lock);
}
int pthread_rwlock_tryrdlock(pthread_rwlock_t* lock) noexcept {
    forbid("pthread_rwlock_tryrdlock");
    return next<int(pthread_rwlock_t*)>("pthread_rwlock_tryrdlock")(lock);
}
int pthread_rwlock_trywrlock(pthread_rwlock_t* lock) noexcept {
    forbid("pthread_rwlock_trywrlock");
    return next<int(pthread_rwlock_t*)>("pthread_rwlock_trywrlock")(lock);
}
int pthread_rwlock_timedrdlock(pthread_rwlock_t* lock, const timespec* until) noexcept {
    forbid("pthread_rwlock_timedrdlock");
    return next<int(pthread_rwlock_t*, const timespec*)>("pthread_rwlock_timedrdlock")(lock, until);
}
int pthread_rwlock_timedwrlock(pthread_rwlock_t* lock, const timespec* until) noexcept {
    forbid("pthread_rwlock_timedwrlock");
    return next<int(pthread_rwlock_t*, const timespec*)>("pthread_rwlock_timedwrlock")(lock, until);
}
int pthread_spin_lock(pthread_spinlock_t* lock) noexcept {
    forbid("pthread_spin_lock");
    return next<int(pthread_spinlock_t*)>("pthread_spin_lock")(lock);
}
int pthread_cond_wait(pthread_cond_t* condition, pthread_mutex_t* mutex) {
    forbid("pthread_cond_wait");
    return next<int(pthread_cond_t*, pthread_mutex_t*)>("pthread_cond_wait")(condition, mutex);
}
int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const timespec* until) {
    forbid("pthread_cond_timedwait");
    return next<int(pthread_cond_t*, pthread_mutex_t*, const timespec*)>("pthread_cond_timedwait")(
        condition, mutex, until);
}
int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                           const timespec* until) {
    forbid("pthread_cond_clockwait");
    return next<int(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*)>("pthread_cond_clockwait")(
        condition, mutex, clock, until);
}
int pthread_cond_signal(pthread_cond_t* condition) noexcept {
    forbid("pthread_cond_signal");
    return next<int(pthread_cond_t*)>("pthread_cond_signal")(condition);
}
int pthread_cond_broadcast(pthread_cond_t* condition) noexcept {
    forbid("pthread_cond_broadcast");
    return next<int(pthread_cond_t*)>("pthread_cond_broadcast")(condition);
}
int pthread_barrier_wait(pthread_barrier_t* barrier) noexcept {
    forbid("pthread_barrier_wait");
    return next<int(pthread_barrier_t*)>("pthread_barrier_wait")(barrier);
}
int pthread_once(pthread_once_t* once, void (*function)()) {
    forbid("pthread_once");
    return next<int(pthread_once_t*, void (*)())>("pthread_once")(once, function);
}
int sem_wait(sem_t* semaphore) {
    forbid("sem_wait");
    return next<int(sem_t*)>("sem_wait")(semaphore);
}
int sem_trywait(sem_t* semaphore) noexcept {
    forbid("sem_trywait");
    return next<int(sem_t*)>("sem_trywait")(semaphore);
}
int sem_timedwait(sem_t* semaphore, const timespec* until) {
    forbid("sem_timedwait");
    return next<int(sem_t*, const timespec*)>("sem_timedwait")(semaphore, until);
}
int sem_clockwait(sem_t* semaphore, clockid_t clock, const timespec* until) {
    forbid("sem_clockwait");
    return next<int(sem_t*, clockid_t, const timespec*)>("sem_clockwait")(semaphore, clock, until);
}
int sem_post(sem_t* semaphore) noexcept {
    forbid("sem_post");
    return next<int(sem_t*)>("sem_post")(semaphore);
}
int mtx_lock(mtx_t* mutex) {
    forbid("mtx_lock");
    return next<int(mtx_t*)>("mtx_lock")(mutex);
}
int cnd_wait(cnd_t* condition, mtx_t* mutex) {
    forbid("cnd_wait");
    return next<int(cnd_t*, mtx_t*)>("cnd_wait")(condition, mutex);
}

// --- waiting: what the kernel's diversion of system calls would catch too, where there is one -------------

long syscall(long number, ...) noexcept {  // futexes, for one: std::atomic's wait()
    forbid("syscall");
    std::va_list list;
    va_start(list, number);
    std::array<long, 6> a{};
    for (long& each : a) each = va_arg(list, long);
    va_end(list);
    return next<long(long, ...)>("syscall")(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
int nanosleep(const timespec* time, timespec* rest) {
    forbid("nanosleep");
    return next<int(const timespec*, timespec*)>("nanosleep")(time, rest);
}
int clock_nanosleep(clockid_t clock, int flags, const timespec* time, timespec* rest) {
    forbid("clock_nanosleep");
    return next<int(clockid_t, int, const timespec*, timespec*)>("clock_nanosleep")(clock, flags, time, rest);
}
int poll(pollfd* files, nfds_t count, int timeout_ms) {
    forbid("poll");
    return next<int(pollfd*, nfds_t, int)>("poll")(files, count, timeout_ms);
}
ssize_t write(int file, const void* data, std::size_t size) {
    forbid("write");
    return next<ssize_t(int, const void*, std::size_t)>("write")(file, data, size);
}
ssize_t read(int file, void* data, std::size_t size) {
    forbid("read");
    return next<ssize_t(int, void*, std::size_t)>("read")(file, data, size);
}
}
