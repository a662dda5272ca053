#include "hal/linux/system_random.hpp"

#include <sys/random.h>

namespace wheelwright::hal {

bool SystemRandom::fill(std::span<std::uint8_t> out) {
    return getrandom(out.data(), out.size(), GRND_NONBLOCK) == static_cast<ssize_t>(out.size());
}

}  // namespace wheelwright::hal
