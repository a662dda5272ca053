// What systemd hears on the socket that it names.
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>

#include "hal/linux/service_manager.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

constexpr std::int64_t kMs = 1'000'000;

// A manager that listens, at a name in the abstract name space.
class Manager {
  public:
    Manager() : name_("@wheelwright-test-" + std::to_string(::getpid())) {
        socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        std::memcpy(address.sun_path + 1, name_.data() + 1, name_.size() - 1);
        const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name_.size());
        CHECK_EQUAL(0, ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), length));
        ::setenv("NOTIFY_SOCKET", name_.c_str(), 1);
    }
    ~Manager() {
        ::close(socket_);
        for (const char* variable : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(variable);
    }
    Manager(const Manager&) = delete;
    Manager& operator=(const Manager&) = delete;

    std::string heard() const {
        std::array<char, 64> text{};
        const ssize_t size = ::recv(socket_, text.data(), text.size(), 0);
        return size < 0 ? "" : std::string(text.data(), static_cast<std::size_t>(size));
    }

  private:
    std::string name_;
    int socket_;
};

void same(const char* expected, const std::string& text) { STRCMP_EQUAL(expected, text.c_str()); }

}  // namespace

TEST_GROUP(ServiceManager){};

TEST(ServiceManager, is_told_that_we_live_four_times_in_its_time_at_most) {
    const Manager manager;
    ::setenv("WATCHDOG_USEC", "200000", 1);
    hal::ServiceManager service;
    CHECK(service.watches());
    service.ready();
    same("READY=1", manager.heard());
    int times = 0;
    for (std::int64_t t = 0; t < 1000; ++t) {
        service.alive((5 + t) * kMs);
        const std::string heard = manager.heard();
        if (heard.empty()) continue;
        same("WATCHDOG=1", heard);
        ++times;
    }
    CHECK_EQUAL(20, times);
    service.stopping();
    same("STOPPING=1", manager.heard());
}

TEST(ServiceManager, is_not_told_what_it_did_not_ask_this_process_for) {
    const Manager manager;
    ::setenv("WATCHDOG_USEC", "200000", 1);
    ::setenv("WATCHDOG_PID", "1", 1);
    hal::ServiceManager service;
    CHECK(!service.watches());
    service.alive(kMs);
    same("", manager.heard());
}

TEST(ServiceManager, that_is_not_there_or_does_not_listen_changes_nothing) {
    hal::ServiceManager none;
    CHECK(!none.watches());
    none.ready();
    none.alive(kMs);
    for (const char* name : {"", "/", "relative", "/nowhere/at/all", "@nobody-listens-here"}) {
        ::setenv("NOTIFY_SOCKET", name, 1);
        hal::ServiceManager deaf;
        deaf.ready();
    }
    ::setenv("NOTIFY_SOCKET", std::string(200, '/').c_str(), 1);
    hal::ServiceManager too_long;
    too_long.ready();
    ::unsetenv("NOTIFY_SOCKET");
}
