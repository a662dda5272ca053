// Uses the heap, and therefore must fail to link for the bare target.
#include <cstdlib>

extern "C" int run();

int run() {
    static void* volatile kept = nullptr;
    kept = std::malloc(16);
    return kept != nullptr ? 0 : 1;
}
