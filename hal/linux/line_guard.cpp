#include "hal/linux/line_guard.hpp"

#include <sys/prctl.h>
#include <unistd.h>

#include <csignal>

#include "hal/linux/realtime.hpp"

namespace wheelwright::hal {

bool guard_line(DigitalOutput& line, int priority) {
    // What ends the firmware in order, or because it hangs, may reach its whole group; the guard hears one
    // signal only, which nobody sends but the kernel. That comes before the memory of a killed process is
    // taken down: a pipe's end would come 20 ms later.
    const int parent_died = SIGRTMAX;
    sigset_t all;
    sigset_t ours;
    sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, &ours);
    const pid_t firmware = ::getpid();
    const pid_t guard = ::fork();
    if (guard != 0) {
        ::pthread_sigmask(SIG_SETMASK, &ours, nullptr);
        return guard > 0;
    }
    ::prctl(PR_SET_PDEATHSIG, parent_died);
    ::prctl(PR_SET_NAME, "line-guard");
    set_fifo_priority(priority);
    sigset_t awaited;
    sigemptyset(&awaited);
    sigaddset(&awaited, parent_died);
    while (::getppid() == firmware && ::sigwaitinfo(&awaited, nullptr) != parent_died) {
    }
    line.write(false);
    ::_exit(0);
}

}  // namespace wheelwright::hal
