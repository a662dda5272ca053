// How much stack a cycle uses at most, over everything it can be asked to do: the stack below is painted
// before each of its two parts and looked at afterwards. Fails above kMost_bytes.
#include <pthread.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <string>

#include "hal/linux/realtime.hpp"
#include "tests/alloc/every_cycle.hpp"

namespace {

using namespace wheelwright;

constexpr std::size_t kMost_bytes = 16 * 1024;
constexpr std::size_t kPainted_bytes = 64 * 1024;  // what may be measured
constexpr std::size_t kOwn_bytes = 512;            // of the measuring function's own frame
constexpr std::uint64_t kPaint = 0x5AFEC0DE5AFEC0DE;
static_assert(kMost_bytes <= hal::RealtimeOptions{}.stack_bytes / 4,
              "what is faulted in beforehand is plenty");
static_assert(kMost_bytes < kPainted_bytes);

std::size_t worst_bytes = 0;
const char* scene = "";
const char* worst_scene = "";

[[gnu::noinline]] void measure(const std::function<void()>& part) {
    const auto here = reinterpret_cast<std::uintptr_t>(__builtin_frame_address(0)) & ~std::uintptr_t{7};
    auto* const top = reinterpret_cast<volatile std::uint64_t*>(here - kOwn_bytes);
    auto* const bottom = reinterpret_cast<volatile std::uint64_t*>(here - kPainted_bytes);
    for (volatile std::uint64_t* p = bottom; p < top; ++p) *p = kPaint;
    part();
    const volatile std::uint64_t* p = bottom;
    while (p < top && *p == kPaint) ++p;
    const std::size_t used = here - reinterpret_cast<std::uintptr_t>(p);
    if (used > worst_bytes) {
        worst_bytes = used;
        worst_scene = scene;
    }
}

void* drive(void* result) {
    auto& missing = *static_cast<std::size_t*>(result);
    const alloc::Tour tour = alloc::drive_everything(measure, [](const char* what) { scene = what; });
    missing = tour.missing().size();
    std::printf("%llu cycles\n", static_cast<unsigned long long>(tour.cycles));
    return nullptr;
}

}  // namespace

int main() {
    // A thread of its own, so that there is room to paint.
    std::size_t missing = 1;
    pthread_attr_t attributes;
    pthread_t thread{};
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, 1024 * 1024);
    if (pthread_create(&thread, &attributes, drive, &missing) != 0) return 1;
    pthread_join(thread, nullptr);
    std::printf("worst stack use of a cycle: %zu bytes (%s); allowed %zu, faulted in beforehand %zu\n",
                worst_bytes, worst_scene, kMost_bytes, hal::RealtimeOptions{}.stack_bytes);
    return missing == 0 && worst_bytes > kOwn_bytes && worst_bytes <= kMost_bytes ? 0 : 1;
}
