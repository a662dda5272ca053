// systemd, where it has started us with NOTIFY_SOCKET and WATCHDOG_USEC (sd_notify(3)): told that we are
// ready, and again and again that we live. What it is not told for WatchdogSec it kills, and starts anew as
// the unit says. Without these variables nothing is sent.
//
// Threads: one at a time. No call but the constructor allocates; none blocks or throws.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>

#include <cstdint>
#include <string_view>

namespace wheelwright::hal {

class ServiceManager {
  public:
    ServiceManager();  // reads the environment
    ~ServiceManager();
    ServiceManager(const ServiceManager&) = delete;
    ServiceManager& operator=(const ServiceManager&) = delete;

    void ready() { say("READY=1"); }
    void stopping() { say("STOPPING=1"); }
    // To be called often: says it four times in WatchdogSec at most.
    void alive(std::int64_t now_ns);

    bool watches() const { return interval_ns_ > 0; }

  private:
    void say(std::string_view state) const;

    int socket_ = -1;
    sockaddr_un address_{};
    socklen_t length_ = 0;
    std::int64_t interval_ns_ = 0;  // 0: it does not watch
    std::int64_t next_ns_ = 0;
};

}  // namespace wheelwright::hal
