#include "hal/linux/service_manager.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <string>

namespace wheelwright::hal {
namespace {

std::int64_t number_in(const char* variable) {
    const char* text = std::getenv(variable);
    return text == nullptr ? 0 : std::strtoll(text, nullptr, 10);
}

}  // namespace

ServiceManager::ServiceManager() {
    const char* path = std::getenv("NOTIFY_SOCKET");
    if (path == nullptr) return;
    const std::string_view name = path;
    const bool usable = name.size() > 1 && (name[0] == '/' || name[0] == '@');
    if (!usable || name.size() >= sizeof address_.sun_path) return;
    address_.sun_family = AF_UNIX;
    std::copy(name.begin(), name.end(), std::begin(address_.sun_path));
    length_ = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    if (name[0] == '@') {
        address_.sun_path[0] = '\0';  // abstract: the length says where it ends
    } else {
        ++length_;
    }
    socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const std::int64_t pid = number_in("WATCHDOG_PID");
    if (pid == 0 || pid == ::getpid()) interval_ns_ = 1000 * number_in("WATCHDOG_USEC") / 4;
}

ServiceManager::~ServiceManager() {
    if (socket_ >= 0) ::close(socket_);
}

void ServiceManager::alive(std::int64_t now_ns) {
    if (interval_ns_ <= 0 || now_ns < next_ns_) return;
    next_ns_ = now_ns + interval_ns_;
    say("WATCHDOG=1");
}

void ServiceManager::say(std::string_view state) const {
    if (socket_ < 0) return;
    // A manager that does not listen is no reason to do anything: the answer is its own.
    static_cast<void>(::sendto(socket_, state.data(), state.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
                               reinterpret_cast<const sockaddr*>(&address_), length_));
}

}  // namespace wheelwright::hal
