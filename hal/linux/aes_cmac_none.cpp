// Built without mbedTLS: there is no key, and who names one is told.
#include "hal/linux/aes_cmac.hpp"

namespace wheelwright::hal {

Result<std::unique_ptr<MessageCode>> make_aes_cmac(const std::array<std::uint8_t, 16>&) {
    return Error{
        "this program was built without mbedTLS, so it cannot use a key; install libmbedtls-dev and build "
        "again"};
}

}  // namespace wheelwright::hal
