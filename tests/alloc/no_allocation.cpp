// Fails when a cycle of the firmware allocates, frees, throws, locks, waits or (where the kernel helps to
// watch) makes any system call.
//   no_allocation          drives everything under the guard
//   no_allocation --bites  proves that the guard bites: each forbidden thing, planted in a cycle, must end a
//   child
//                          process
#include <pthread.h>
#include <semaphore.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tests/alloc/every_cycle.hpp"
#include "tests/alloc/guard.hpp"
#include "tools/sim/cycle_rig.hpp"

namespace {

using namespace wheelwright;

int drive() {
    const bool all = guard::prepare();
    std::printf("system calls are %s\n", all ? "watched too" : "NOT watched: this kernel cannot divert them");
    std::fflush(stdout);
    const alloc::Tour tour = alloc::drive_everything(
        [](const std::function<void()>& part) {
            const guard::Armed armed;
            part();
        },
        guard::set_scene);
    std::printf("%llu cycles without allocation, exception, lock or wait\n",
                static_cast<unsigned long long>(tour.cycles));
    for (const std::string& what : tour.missing()) std::printf("never seen: %s\n", what.c_str());
    return tour.missing().empty() ? 0 : 1;
}

// --- the proof -------------------------------------------------------------------------------------------

void* volatile sink = nullptr;
void* volatile other = nullptr;
volatile std::size_t size = 100;

struct Plant {
    const char* what;
    std::function<void()> act;
    bool only_with_system_calls = false;
};

class Saboteur final : public tools::FrontBus {
  public:
    std::function<void()> act;
    hal::CanStatus send(const hal::CanFrame& frame) override {
        if (act) act();
        return FrontBus::send(frame);
    }
};

std::vector<Plant> plants() {
    static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    static pthread_rwlock_t lock = PTHREAD_RWLOCK_INITIALIZER;
    static pthread_cond_t condition = PTHREAD_COND_INITIALIZER;
    static sem_t semaphore;
    sem_init(&semaphore, 0, 1);
    static std::string text(15, 'x');
    static std::mutex wrapped;
    sink = std::malloc(100);
    return {
        {"malloc", [] { sink = std::malloc(size); }},
        {"calloc", [] { sink = std::calloc(size, 8); }},
        {"realloc", [] { other = std::realloc(sink, 2 * size); }},
        {"free", [] { std::free(sink); }},
        {"aligned_alloc", [] { sink = std::aligned_alloc(64, 64 * size); }},
        {"posix_memalign",
         [] {
             void* memory = nullptr;
             if (posix_memalign(&memory, 64, size) == 0) sink = memory;
         }},
        {"operator new", [] { sink = new std::array<char, 10>; }},
        {"a growing string", [] { text += "grows"; }},
        {"a growing vector", [] { sink = std::make_unique<std::vector<int>>(size).release(); }},
        {"an exception that is caught",
         [] {
             try {
                 if (size > 0) throw 7;
             } catch (int) {
                 sink = nullptr;
             }
         }},
        {"pthread_mutex_lock", [] { pthread_mutex_lock(&mutex); }},
        {"pthread_mutex_trylock", [] { sink = pthread_mutex_trylock(&mutex) == 0 ? &mutex : nullptr; }},
        {"std::mutex", [] { const std::lock_guard hold(wrapped); }},
        {"pthread_rwlock_rdlock", [] { pthread_rwlock_rdlock(&lock); }},
        {"pthread_rwlock_wrlock", [] { pthread_rwlock_wrlock(&lock); }},
        {"pthread_cond_wait", [] { pthread_cond_wait(&condition, &mutex); }},
        {"pthread_cond_signal", [] { pthread_cond_signal(&condition); }},
        {"sem_wait", [] { sem_wait(&semaphore); }},
        {"a static object's first use", [] { static std::string late(size, 'x'); }},
        {"printf", [] { std::printf("%s\n", "logs"), std::fflush(stdout); }, true},
        {"sleeping", [] { usleep(1); }},
        {"a system call", [] { sink = getppid() == 1 ? nullptr : &mutex; }, true},
    };
}

int bites() {
    const tools::ExampleRobots robots = tools::example_robots(true);
    int wrong = 0;
    std::vector<Plant> all = plants();
    all.push_back({"nothing", [] {}});
    for (const Plant& plant : all) {
        std::fflush(stdout);
        const pid_t child = fork();
        if (child < 0) return 1;
        if (child == 0) {
            if (std::freopen("/dev/null", "w", stderr) == nullptr) _exit(1);
            const bool system_calls = guard::prepare();
            Saboteur saboteur;
            tools::RigOptions options;
            options.world = robots.world;
            options.front = &saboteur;
            tools::CycleRig rig(robots.controller, robots.truth, options);
            const auto guarded = [](auto&& part) {
                const guard::Armed armed;
                part();
            };
            for (int i = 0; i < 50; ++i) rig.step(guarded);
            if (plant.only_with_system_calls && !system_calls) _exit(guard::kBitten);
            saboteur.act = plant.act;
            for (int i = 0; i < 50; ++i) rig.step(guarded);
            _exit(0);
        }
        int status = 0;
        waitpid(child, &status, 0);
        const int expected = std::string_view(plant.what) == "nothing" ? 0 : guard::kBitten;
        const bool right = WIFEXITED(status) && WEXITSTATUS(status) == expected;
        std::printf("%-30s %s\n", plant.what, right ? (expected == 0 ? "passes" : "bitten") : "WRONG");
        if (!right) ++wrong;
    }
    return wrong == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc == 1) return drive();
    if (argc == 2 && std::string_view(argv[1]) == "--bites") return bites();
    return 2;
}
