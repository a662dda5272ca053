// A message authentication code under a key that only its implementation knows: AES-128-CMAC, RFC 4493.
// Implementation: hal/linux (mbedTLS).
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace wheelwright::hal {

class MessageCode {
  public:
    virtual ~MessageCode() = default;

    // The whole 16 bytes; false: it could not be computed. Called in a cycle: neither allocates nor blocks.
    virtual bool compute(std::span<const std::uint8_t> text, std::array<std::uint8_t, 16>& code) = 0;
};

}  // namespace wheelwright::hal
