// Built without mbedTLS: there is no key, and who names one is told.
#include "hal/linux/cryptography.hpp"

namespace wheelwright::hal {
namespace {

Error missing() {
    return {
        "this program was built without mbedTLS, so it cannot use a key; install libmbedtls-dev and build "
        "again"};
}

}  // namespace

Result<std::unique_ptr<MessageCode>> make_aes_cmac(const std::array<std::uint8_t, 16>&) { return missing(); }
Result<std::unique_ptr<RandomSource>> make_random() { return missing(); }

}  // namespace wheelwright::hal
