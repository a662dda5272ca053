// AES-128-CMAC of mbedTLS.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "hal/linux/result.hpp"
#include "hal/message_code.hpp"

namespace wheelwright::hal {

// For start-up: it may allocate; the object then does not. An error where the build has no mbedTLS. One
// object serves one thread.
Result<std::unique_ptr<MessageCode>> make_aes_cmac(const std::array<std::uint8_t, 16>& key);

}  // namespace wheelwright::hal
