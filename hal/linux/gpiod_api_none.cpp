// Built where libgpiod's development files are missing.
#include "hal/linux/gpiod_api.hpp"

namespace wheelwright::hal::gpiod_api {

Requested request(const char* /*path*/, const LineOptions& /*options*/, bool /*output*/) {
    return {nullptr, Step::no_library, 0};
}

}  // namespace wheelwright::hal::gpiod_api
