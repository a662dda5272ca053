#include "hal/linux/aes_cmac.hpp"

#include <mbedtls/cmac.h>

#include <utility>

namespace wheelwright::hal {
namespace {

// The context is made once; a message then needs no memory.
class AesCmac final : public MessageCode {
  public:
    AesCmac() { mbedtls_cipher_init(&context_); }
    ~AesCmac() override { mbedtls_cipher_free(&context_); }
    AesCmac(const AesCmac&) = delete;
    AesCmac& operator=(const AesCmac&) = delete;

    bool start(const std::array<std::uint8_t, 16>& key) {
        return mbedtls_cipher_setup(&context_, mbedtls_cipher_info_from_type(MBEDTLS_CIPHER_AES_128_ECB)) ==
                   0 &&
               mbedtls_cipher_cmac_starts(&context_, key.data(), 8 * key.size()) == 0;
    }

    bool compute(std::span<const std::uint8_t> text, std::array<std::uint8_t, 16>& code) override {
        return mbedtls_cipher_cmac_reset(&context_) == 0 &&
               (text.empty() || mbedtls_cipher_cmac_update(&context_, text.data(), text.size()) == 0) &&
               mbedtls_cipher_cmac_finish(&context_, code.data()) == 0;
    }

  private:
    mbedtls_cipher_context_t context_{};
};

}  // namespace

Result<std::unique_ptr<MessageCode>> make_aes_cmac(const std::array<std::uint8_t, 16>& key) {
    auto cmac = std::make_unique<AesCmac>();
    if (!cmac->start(key)) return Error{"mbedTLS refuses AES-128-CMAC"};
    return std::unique_ptr<MessageCode>(std::move(cmac));
}

}  // namespace wheelwright::hal
