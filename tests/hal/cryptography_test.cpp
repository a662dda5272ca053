// AES-128-CMAC against the examples of RFC 4493, section 4; random numbers.
#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "hal/linux/cryptography.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

std::vector<std::uint8_t> bytes_of(std::string_view hex) {
    std::vector<std::uint8_t> bytes;
    for (std::size_t i = 0; i < hex.size(); i += 2) {
        const auto digit = [](char c) { return static_cast<unsigned>(c <= '9' ? c - '0' : c - 'a' + 10); };
        bytes.push_back(static_cast<std::uint8_t>(digit(hex[i]) << 4U | digit(hex[i + 1])));
    }
    return bytes;
}

constexpr std::string_view kKey = "2b7e151628aed2a6abf7158809cf4f3c";
constexpr std::string_view kMessage =
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
    "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710";

}  // namespace

TEST_GROUP(AesCmac){};

TEST(AesCmac, gives_the_examples_of_rfc_4493) {
    struct Example {
        std::size_t length;
        std::string_view code;
    };
    constexpr std::array kExamples{
        Example{0, "bb1d6929e95937287fa37d129b756746"}, Example{16, "070a16b46b4d4144f79bdd9dd04a287c"},
        Example{40, "dfa66747de9ae63030ca32611497c827"}, Example{64, "51f0bebf7e3b9d92fc49741779363cfe"}};
    std::array<std::uint8_t, 16> key{};
    const auto key_bytes = bytes_of(kKey);
    std::copy(key_bytes.begin(), key_bytes.end(), key.begin());
    auto made = hal::make_aes_cmac(key);
    CHECK(made.has_value());
    for (int round = 0; round < 2; ++round) {  // the object is used again and again
        for (const Example& example : kExamples) {
            const auto text = bytes_of(kMessage.substr(0, 2 * example.length));
            std::array<std::uint8_t, 16> code{};
            CHECK(made.value()->compute(text, code));
            CHECK(std::vector<std::uint8_t>(code.begin(), code.end()) == bytes_of(example.code));
        }
    }
}

TEST_GROUP(RandomNumbers){};

TEST(RandomNumbers, fill_all_and_are_never_the_same) {
    const auto one = std::move(hal::make_random().value());
    const auto other = std::move(hal::make_random().value());
    std::array<std::array<std::uint8_t, 8>, 100> drawn{};
    std::array<bool, 8> changes{};
    for (std::size_t i = 0; i < drawn.size(); ++i) CHECK((i % 2 == 0 ? *one : *other).fill(drawn[i]));
    for (std::size_t i = 1; i < drawn.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) CHECK(drawn[i] != drawn[j]);
        for (std::size_t k = 0; k < 8; ++k) changes[k] = changes[k] || drawn[i][k] != drawn[0][k];
    }
    for (const bool byte : changes) CHECK(byte);
}
