#include "hal/linux/cryptography.hpp"

#include <mbedtls/cmac.h>
#include <mbedtls/ctr_drbg.h>
#include <sys/random.h>

#include <limits>
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

class CtrDrbg final : public RandomSource {
  public:
    CtrDrbg() { mbedtls_ctr_drbg_init(&context_); }
    ~CtrDrbg() override { mbedtls_ctr_drbg_free(&context_); }
    CtrDrbg(const CtrDrbg&) = delete;
    CtrDrbg& operator=(const CtrDrbg&) = delete;

    // It is not seeded again, which would call the system: some thousand challenges are far from its limit.
    bool start() {
        const bool seeded = mbedtls_ctr_drbg_seed(&context_, &from_kernel, nullptr, nullptr, 0) == 0;
        mbedtls_ctr_drbg_set_reseed_interval(&context_, std::numeric_limits<int>::max());
        return seeded;
    }

    // The form of the call that takes no mutex.
    bool fill(std::span<std::uint8_t> out) override {
        return mbedtls_ctr_drbg_random_with_add(&context_, out.data(), out.size(), nullptr, 0) == 0;
    }

  private:
    static int from_kernel(void*, unsigned char* out, std::size_t size) {
        return getrandom(out, size, 0) == static_cast<ssize_t>(size) ? 0 : -1;
    }

    mbedtls_ctr_drbg_context context_{};
};

}  // namespace

Result<std::unique_ptr<MessageCode>> make_aes_cmac(const std::array<std::uint8_t, 16>& key) {
    auto cmac = std::make_unique<AesCmac>();
    if (!cmac->start(key)) return Error{"mbedTLS refuses AES-128-CMAC"};
    return std::unique_ptr<MessageCode>(std::move(cmac));
}

Result<std::unique_ptr<RandomSource>> make_random() {
    auto random = std::make_unique<CtrDrbg>();
    if (!random->start()) return Error{"the kernel gives no random numbers"};
    return std::unique_ptr<RandomSource>(std::move(random));
}

}  // namespace wheelwright::hal
