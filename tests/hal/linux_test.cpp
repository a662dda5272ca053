// What of hal/linux can be judged without a device: refusals, and the sentences they come with.
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "hal/linux/realtime.hpp"
#include "hal/linux/socketcan_bus.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

// Runs `body` in a child process, so that priorities, limits and users are its own. Its answer is the status.
template <typename Body>
int in_a_child(Body body) {
    std::fflush(stdout);
    const pid_t child = fork();
    if (child == 0) {
        _exit(body());
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 100;
}

// Takes away what could grant real time. False: that did not work either. Root of a user namespace that has
// no such user has no rights outside it anyway.
bool become_nobody() {
    const rlimit none{0, 0};
    return setrlimit(RLIMIT_RTPRIO, &none) == 0 && setrlimit(RLIMIT_MEMLOCK, &none) == 0 &&
           (geteuid() != 0 || setuid(65534) == 0 || errno == EINVAL);
}

}  // namespace

// The address sanitizer replaces mlockall() by nothing, which then cannot be refused either.
#ifdef __clang__
constexpr bool locks_are_real = !__has_feature(address_sanitizer);
#else
constexpr bool locks_are_real = true;
#endif

TEST_GROUP(Realtime){};

TEST(Realtime, without_privileges_every_refusal_names_what_is_missing_and_what_to_do) {
    LONGS_EQUAL(
        0, in_a_child([] {
            if (!become_nobody()) {
                return 1;
            }
            hal::RealtimeOptions options;
            options.priority = 80;
            const auto refusals = hal::become_realtime(options);
            if (refusals.size() != (locks_are_real ? 2 : 1)) {
                return 2;
            }
            for (const hal::Refusal& refusal : refusals) {
                std::printf("%s\n", refusal.sentence().c_str());
            }
            std::fflush(stdout);
            const std::string memory = refusals.front().sentence();
            const std::string priority = refusals.back().sentence();
            if (locks_are_real && !(contains(memory, "CAP_IPC_LOCK") && contains(memory, "LimitMEMLOCK"))) {
                return 4;
            }
            return contains(priority, "CAP_SYS_NICE") && contains(priority, "80") &&
                           contains(priority, "LimitRTPRIO=80") && sched_getscheduler(0) == SCHED_OTHER
                       ? 0
                       : 3;
        }));
}

TEST(Realtime, what_is_not_refused_is_in_force) {
    LONGS_EQUAL(0, in_a_child([] {
                    const bool priority_refused = hal::set_fifo_priority(42).has_value();
                    sched_param parameter{};
                    sched_getparam(0, &parameter);
                    const bool fifo = sched_getscheduler(0) == SCHED_FIFO && parameter.sched_priority == 42;
                    if (priority_refused == fifo) {
                        return 1;
                    }
                    cpu_set_t mine;
                    sched_getaffinity(0, sizeof mine, &mine);
                    int first = 0;
                    while (!CPU_ISSET(static_cast<std::size_t>(first), &mine)) {
                        ++first;
                    }
                    if (hal::pin_to_cpu(first)) {
                        return 2;
                    }
                    sched_getaffinity(0, sizeof mine, &mine);
                    if (CPU_COUNT(&mine) != 1 || !CPU_ISSET(static_cast<std::size_t>(first), &mine)) {
                        return 3;
                    }
                    return hal::prefault_stack(512 * 1024) ? 4 : 0;
                }));
}

TEST(Realtime, a_locked_process_says_so_in_its_status) {
    LONGS_EQUAL(0, in_a_child([] {
                    const bool refused = hal::lock_memory().has_value();
                    std::FILE* status = std::fopen("/proc/self/status", "r");
                    long locked_kib = -1;
                    char line[256];
                    while (status != nullptr && std::fgets(line, sizeof line, status) != nullptr) {
                        std::sscanf(line, "VmLck: %ld", &locked_kib);
                    }
                    if (status != nullptr) {
                        std::fclose(status);
                    }
                    return refused || locked_kib > 100 || !locks_are_real ? 0 : 1;
                }));
}

TEST(Realtime, what_is_there_is_locked_whole_and_what_comes_later_as_it_is_touched) {
    LONGS_EQUAL(0, in_a_child([] {
                    constexpr std::size_t bytes = 1 << 20;
                    const auto take = [] {
                        return static_cast<char*>(::mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                                                         MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
                    };
                    const auto resident = [](char* memory) {
                        std::vector<unsigned char> pages(bytes / 4096);
                        ::mincore(memory, bytes, pages.data());
                        return std::count_if(pages.begin(), pages.end(), [](auto page) { return page & 1; });
                    };
                    char* const before = take();
                    if (hal::lock_memory()) {
                        return 1;
                    }
                    char* const after = take();
                    after[0] = 1;
                    return !locks_are_real || (resident(before) == bytes / 4096 && resident(after) == 1) ? 0
                                                                                                         : 2;
                }));
}

TEST(Realtime, threads_get_small_stacks) {
    LONGS_EQUAL(0, in_a_child([] {
                    hal::limit_thread_stacks();
                    std::size_t bytes = 0;
                    std::thread([&bytes] {
                        pthread_attr_t attributes;
                        pthread_getattr_np(pthread_self(), &attributes);
                        pthread_attr_getstacksize(&attributes, &bytes);
                        pthread_attr_destroy(&attributes);
                    }).join();
                    return bytes > 0 && bytes <= 512 * 1024 ? 0 : 1;
                }));
}

TEST(Realtime, impossible_requests_are_refused_without_naming_a_privilege) {
    const auto priority = hal::set_fifo_priority(1000);
    CHECK(priority.has_value());
    CHECK(priority->privilege.empty());
    CHECK(contains(priority->sentence(), "1 to 99"));
    for (const int cpu : {-1, 1023, 1'000'000}) {
        const auto refusal = hal::pin_to_cpu(cpu);
        CHECK(refusal.has_value());
        CHECK(refusal->privilege.empty());
        CHECK(contains(refusal->sentence(), std::to_string(cpu).c_str()));
    }
    const auto stack = hal::prefault_stack(std::size_t{1} << 40);
    CHECK(stack.has_value());
    CHECK(contains(stack->sentence(), "ulimit -s"));
}

TEST_GROUP(SocketCanOpen){};

TEST(SocketCanOpen, a_name_no_interface_can_have_is_a_mistake_of_usage) {
    for (const char* name : {"", "a-name-of-more-than-15", "exactly16letters"}) {
        const auto bus = hal::SocketCanBus::open(name);
        CHECK(!bus);
        LONGS_EQUAL(1, bus.error().exit_status());
        CHECK(contains(bus.error().message, name));
    }
}

TEST(SocketCanOpen, a_missing_interface_or_kernel_part_is_a_lack_of_the_machine_with_a_remedy) {
    const auto bus = hal::SocketCanBus::open("nocan7");
    CHECK(!bus);
    std::printf("%s\n", bus.error().message.c_str());
    LONGS_EQUAL(4, bus.error().exit_status());
    CHECK(contains(bus.error().message, "`"));
}
