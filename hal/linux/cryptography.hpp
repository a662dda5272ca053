// What mbedTLS does for us: AES-128-CMAC (RFC 4493), and random numbers by CTR_DRBG (NIST SP 800-90A).
//
// The functions are for start-up: they may allocate and call the system; the objects then do neither. An
// error where the build has no mbedTLS. One object serves one thread.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "hal/linux/result.hpp"
#include "hal/message_code.hpp"
#include "hal/random_source.hpp"

namespace wheelwright::hal {

Result<std::unique_ptr<MessageCode>> make_aes_cmac(const std::array<std::uint8_t, 16>& key);

// Seeded from the kernel (getrandom).
Result<std::unique_ptr<RandomSource>> make_random();

}  // namespace wheelwright::hal
