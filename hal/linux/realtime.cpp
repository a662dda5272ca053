#include "hal/linux/realtime.hpp"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <system_error>

namespace wheelwright::hal {

namespace {

std::string reason(int error) { return std::generic_category().message(error); }

constexpr std::size_t stack_step = 16 * 1024;

[[gnu::noinline]] void touch_stack(std::size_t bytes) {
    [[maybe_unused]] volatile char
        block[stack_step];  // NOLINT(*-avoid-c-arrays): it is the stack that is wanted
    for (std::size_t i = 0; i < stack_step; i += 1024) {
        block[i] = 0;
    }
    if (bytes > stack_step) {
        touch_stack(bytes - stack_step);
    }
    block[0] = 1;  // after the call, so that it is not made a loop over one block
}

}  // namespace

std::string Refusal::sentence() const {
    std::string text = "No " + what;
    if (!privilege.empty()) {
        text += ": " + privilege + " is missing";
    }
    return text + "; " + remedy + ".";
}

std::optional<Refusal> set_fifo_priority(int priority) {
    const std::string number = std::to_string(priority);
    sched_param parameter{};
    parameter.sched_priority = priority;
    const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter);
    if (error == 0) {
        return std::nullopt;
    }
    Refusal refusal{"real-time scheduling (SCHED_FIFO) at priority " + number, "", ""};
    if (error == EPERM) {
        refusal.privilege = "CAP_SYS_NICE, or RLIMIT_RTPRIO of at least " + number + ",";
        refusal.remedy = "run as root, or put `LimitRTPRIO=" + number +
                         "` into the systemd service, or `@realtime - rtprio " + number +
                         "` into /etc/security/limits.conf";
    } else {
        refusal.remedy = "the kernel says \"" + reason(error) + "\"; priorities are 1 to 99";
    }
    return refusal;
}

void limit_thread_stacks() {
    constexpr std::size_t stack_bytes = 512 * 1024;
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, stack_bytes);
    pthread_setattr_default_np(&attributes);
    pthread_attr_destroy(&attributes);
}

std::optional<Refusal> lock_memory() {
    if (mlockall(MCL_CURRENT) == 0 && mlockall(MCL_FUTURE | MCL_ONFAULT) == 0) {
        return std::nullopt;
    }
    const int error = errno;
    Refusal refusal{"locked memory (mlockall)", "", ""};
    if (error == EPERM || error == ENOMEM || error == EAGAIN) {
        refusal.privilege = "CAP_IPC_LOCK, or RLIMIT_MEMLOCK above the program's size,";
        refusal.remedy =
            "run as root, or put `LimitMEMLOCK=infinity` into the systemd service, or `@realtime - "
            "memlock unlimited` into /etc/security/limits.conf";
    } else {
        refusal.remedy = "the kernel says \"" + reason(error) + "\"";
    }
    return refusal;
}

std::optional<Refusal> pin_to_cpu(int cpu) {
    cpu_set_t set;
    CPU_ZERO(&set);
    int error = EINVAL;
    if (cpu >= 0 && cpu < CPU_SETSIZE) {
        CPU_SET(static_cast<std::size_t>(cpu), &set);
        error = pthread_setaffinity_np(pthread_self(), sizeof set, &set);
    }
    if (error == 0) {
        return std::nullopt;
    }
    Refusal refusal{"running on processor " + std::to_string(cpu) + " only", "", ""};
    if (error == EINVAL) {
        refusal.remedy =
            "it does not exist here or is not ours to use; `taskset -p 1` and `nproc` show which are";
    } else {
        refusal.remedy = "the kernel says \"" + reason(error) + "\"";
    }
    return refusal;
}

std::optional<Refusal> prefault_stack(std::size_t bytes) {
    constexpr std::size_t in_use_already = 64 * 1024;  // by the callers: a generous guess
    pthread_attr_t attributes;
    std::size_t size = 0;
    if (pthread_getattr_np(pthread_self(), &attributes) == 0) {
        void* lowest = nullptr;
        pthread_attr_getstack(&attributes, &lowest, &size);
        pthread_attr_destroy(&attributes);
    }
    if (size < bytes + in_use_already) {
        return Refusal{"room for " + std::to_string(bytes / 1024) + " KiB of stack", "",
                       "raise the limit with `ulimit -s`, or with `LimitSTACK=` in the systemd service"};
    }
    touch_stack(bytes);
    return std::nullopt;
}

std::optional<Refusal> keep_processors_awake() {
    constexpr const char* kDevice = "/dev/cpu_dma_latency";
    const int device = open(kDevice, O_WRONLY | O_CLOEXEC);
    const std::int32_t longest_us = 0;
    // Left open: the kernel forgets the wish when it is closed.
    if (device >= 0 && write(device, &longest_us, sizeof longest_us) == sizeof longest_us)
        return std::nullopt;
    if (errno == ENOENT) return std::nullopt;
    return Refusal{"quick waking from idle states", "",
                   std::string("let it open ") + kDevice +
                       " for writing, as the package's udev rule does, or run as root: the kernel says \"" +
                       reason(errno) + "\""};
}

std::vector<Refusal> become_realtime(const RealtimeOptions& options) {
    std::vector<Refusal> refusals;
    const auto note = [&refusals](std::optional<Refusal> refusal) {
        if (refusal) {
            refusals.push_back(*std::move(refusal));
        }
    };
    if (options.memory) note(lock_memory());
    note(prefault_stack(options.stack_bytes));
    if (options.cpu) {
        note(pin_to_cpu(*options.cpu));
    }
    note(set_fifo_priority(options.priority));
    prctl(PR_SET_TIMERSLACK, 1UL);
    return refusals;
}

}  // namespace wheelwright::hal
