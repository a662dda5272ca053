// A clock for user-mode Linux that other programs' load cannot disturb. Preloaded into linux.uml, it stands
// between that kernel and this machine's clock and timer:
//
// - While the kernel idles, its time jumps to its next timer: waiting costs nothing.
// - While it works, its time passes at 1/kSlowness of this machine's: it seems to run on a quick machine.
// - From one look at this machine's clock to the next no more than kLook counts, and the timer here looks
// every
//   kLook: a spell in which this machine runs something else, or nothing at all, is kLook / kSlowness in
//   there, however long it lasts here.
// - Its time never passes a timer whose signal it has not served, however late this machine delivers that.
//
// Its processes therefore meet their deadlines on any machine; how long a run takes here is another matter.
// What they share with this machine is files and pipes, not time.
//
// The calls replaced are those of linux.uml (package user-mode-linux 6.1), which has one thread and one
// timer, on CLOCK_MONOTONIC. The timer's signal goes to the kernel only when the kernel's timer is due, else
// it is a look. It may interrupt a reading of the clock, which then is done again, and the setting of the
// timer, which it then leaves alone.
#include <dlfcn.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdint>
#include <ctime>

namespace {

// A system call costs some 30 us in there, and a cycle of firmware and simulated robot makes two dozen, so it
// takes most of a millisecond: 1 us of the guest's. What is lost by more slowness is only that a program in
// there that computes instead of waiting takes this much longer than it thinks.
constexpr std::int64_t kSlowness = 1024;
// On a busy machine a cycle is cut in a few spells at most, each 10 us in there. It has to be long beside the
// handling of a signal.
constexpr std::int64_t kLook_ns = 10'000'000;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

using Clock = int (*)(clockid_t, timespec*);
using SetTimer = int (*)(timer_t, int, const itimerspec*, itimerspec*);
using SetHandler = int (*)(int, const struct sigaction*, struct sigaction*);
using Handler = void (*)(int, siginfo_t*, void*);
using Suspend = int (*)(const sigset_t*);

template <class Function>
Function original(const char* name) {
    return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

const auto kClock = original<Clock>("clock_gettime");
const auto kSetTimer = original<SetTimer>("timer_settime");
const auto kSetHandler = original<SetHandler>("sigaction");
const auto kSuspend = original<Suspend>("sigsuspend");

// The kernel's time was `base_ns` when this machine's was `base_machine_ns`, at the last look; it goes on
// from there, and no further than `expiry_ns`, which is its timer's until the kernel sets that anew (0: there
// is none). A timer that repeats, as while the kernel boots, does not hold time.
std::atomic<std::int64_t> base_ns{0};
std::atomic<std::int64_t> base_machine_ns{0};
std::atomic<std::int64_t> expiry_ns{0};
std::atomic<std::int64_t> interval_ns{0};
std::atomic<unsigned> changes{0};  // of the four above, by a signal or by the kernel
std::atomic<bool> setting{false};
timer_t the_timer;
Handler kernels_handler = nullptr;

std::int64_t ns(const timespec& time) { return time.tv_sec * kSecond_ns + time.tv_nsec; }
timespec spec(std::int64_t time) { return {time / kSecond_ns, time % kSecond_ns}; }

std::int64_t machine_ns() {
    timespec now{};
    kClock(CLOCK_MONOTONIC, &now);
    return ns(now);
}

std::int64_t time_at(std::int64_t machine) {
    const std::int64_t since = machine - base_machine_ns;
    if (interval_ns > 0) return base_ns + since / kSlowness;
    const std::int64_t flown = base_ns + std::min(since, kLook_ns) / kSlowness;
    return expiry_ns > 0 ? std::min<std::int64_t>(flown, expiry_ns) : flown;
}

std::int64_t time_ns() {
    for (;;) {
        const unsigned before = changes;
        const std::int64_t time = time_at(machine_ns());
        if (changes == before) return time;
    }
}

void look() {
    const std::int64_t machine = machine_ns();
    base_ns = time_at(machine);
    base_machine_ns = machine;
    ++changes;
}

int arm(std::int64_t first_machine_ns) {
    const itimerspec machine = {spec(interval_ns > 0 ? interval_ns * kSlowness : kLook_ns),
                                spec(first_machine_ns)};
    return kSetTimer(the_timer, 0, &machine, nullptr);
}

void on_timer(int number, siginfo_t* information, void* context) {
    if (setting) return;  // the next look is soon
    if (interval_ns == 0) {
        look();
        if (expiry_ns == 0 || base_ns < expiry_ns) return;
    }
    kernels_handler(number, information, context);
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) {
    if (clock != CLOCK_MONOTONIC) return kClock(clock, time);
    *time = spec(time_ns());
    return 0;
}

int timer_settime(timer_t timer, int, const itimerspec* value, itimerspec*) {
    setting = true;
    look();
    const std::int64_t first = ns(value->it_value);
    interval_ns = ns(value->it_interval);
    expiry_ns = first > 0 ? base_ns + first : 0;
    the_timer = timer;
    const std::int64_t wait = first * kSlowness;
    const int status = arm(interval_ns > 0 || (0 < wait && wait < kLook_ns) ? wait : kLook_ns);
    setting = false;
    return status;
}

// The kernel asks before it idles, and idles only when there is something to wait for; else it looks again.
int timer_gettime(timer_t, itimerspec* value) {
    const std::int64_t left = expiry_ns > 0 ? expiry_ns - time_ns() : 0;
    *value = {spec(interval_ns), spec(interval_ns > 0 ? interval_ns.load() : left)};
    return 0;
}

int sigaction(int number, const struct sigaction* action, struct sigaction* before) {
    if (number != SIGALRM || action == nullptr || (action->sa_flags & SA_SIGINFO) == 0) {
        return kSetHandler(number, action, before);
    }
    kernels_handler = action->sa_sigaction;
    struct sigaction ours = *action;
    ours.sa_sigaction = on_timer;
    return kSetHandler(number, &ours, before);
}

// How the kernel idles, until its timer's signal or another one comes. The signal is the timer's, set to go
// off at once. Disarming the timer and sending the signal oneself would not do: newer kernels drop the signal
// of a timer that has been disarmed, and with it another one of the same number.
int sigsuspend(const sigset_t* mask) {
    if (expiry_ns > 0) {
        look();
        if (interval_ns == 0) base_ns = expiry_ns.load();
        arm(1);
    }
    return kSuspend(mask);
}

}  // extern "C"
