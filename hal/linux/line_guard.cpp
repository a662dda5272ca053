#include "hal/linux/line_guard.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>

#include "hal/linux/realtime.hpp"

namespace wheelwright::hal {

bool guard_line(DigitalOutput& line, int priority) {
    std::array<int, 2> alive{};  // the writing end is open for as long as this process lives
    if (::pipe2(alive.data(), O_CLOEXEC) != 0) return false;
    // What ends the firmware in order, or because it hangs, may reach its whole group; the guard never hears
    // it.
    sigset_t all;
    sigset_t ours;
    sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, &ours);
    const pid_t guard = ::fork();
    if (guard != 0) ::pthread_sigmask(SIG_SETMASK, &ours, nullptr);
    ::close(guard == 0 ? alive[1] : alive[0]);
    if (guard < 0) ::close(alive[1]);
    if (guard != 0) return guard > 0;

    ::prctl(PR_SET_NAME, "line-guard");
    set_fifo_priority(priority);
    char nothing = 0;
    while (::read(alive[0], &nothing, 1) < 0 && errno == EINTR) {
    }
    line.write(false);
    ::_exit(0);
}

}  // namespace wheelwright::hal
