// Vectors: AUTOSAR SWS CRC library, table for CRC-8 SAE J1850; "123456789" from the catalogue of CRC
// algorithms.
#include "firmware/protocol/crc8.hpp"

#include <array>
#include <vector>

#include <CppUTest/TestHarness.h>

using wheelwright::protocol::crc8_sae_j1850;

TEST_GROUP(Crc8){};

TEST(Crc8, gives_the_published_vectors) {
    struct Vector {
        std::vector<std::uint8_t> bytes;
        int crc;
    };
    const std::vector<Vector> vectors{
        {{'1', '2', '3', '4', '5', '6', '7', '8', '9'}, 0x4B},
        {{0x00, 0x00, 0x00, 0x00}, 0x59},
        {{0xF2, 0x01, 0x83}, 0x37},
        {{0x0F, 0xAA, 0x00, 0x55}, 0x79},
        {{0x00, 0xFF, 0x55, 0x11}, 0xB8},
        {{0x33, 0x22, 0x55, 0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF}, 0xCB},
        {{0x92, 0x6B, 0x55}, 0x8C},
        {{0xFF, 0xFF, 0xFF, 0xFF}, 0x74},
    };
    for (const Vector& vector : vectors) {
        BYTES_EQUAL(vector.crc, crc8_sae_j1850(vector.bytes));
    }
}

TEST(Crc8, works_at_compile_time) {
    constexpr std::array<std::uint8_t, 3> bytes{0xF2, 0x01, 0x83};
    static_assert(crc8_sae_j1850(bytes) == 0x37);
    static_assert(crc8_sae_j1850({}) == 0x00);
}

// The claim of the header, over a whole 8-byte frame: Crc in byte 0, covered bytes 1..7.
TEST(Crc8, detects_one_and_two_flipped_bits_and_bursts_up_to_eight) {
    const std::array<std::uint8_t, 8> good = [] {
        std::array<std::uint8_t, 8> frame{0, 0x35, 0x9C, 0x00, 0xFF, 0x42, 0x81, 0x7E};
        frame[0] = crc8_sae_j1850(std::span(frame).subspan(1));
        return frame;
    }();
    const auto passes = [](const std::array<std::uint8_t, 8>& frame) {
        return frame[0] == crc8_sae_j1850(std::span(frame).subspan(1));
    };
    CHECK(passes(good));
    int passed = 0;
    for (unsigned first = 0; first < 64; ++first) {
        for (unsigned second = first; second < 64; ++second) {
            auto frame = good;
            frame.at(first / 8) ^= static_cast<std::uint8_t>(1U << (first % 8));
            if (second != first) frame.at(second / 8) ^= static_cast<std::uint8_t>(1U << (second % 8));
            passed += passes(frame) ? 1 : 0;
        }
    }
    // Bursts as they travel: most significant bit first, within the covered bytes.
    for (unsigned start = 8; start + 8 <= 64; ++start) {
        for (unsigned pattern = 1; pattern < 256; ++pattern) {
            auto frame = good;
            for (unsigned bit = 0; bit < 8; ++bit) {
                if ((pattern >> bit & 1U) != 0) {
                    frame.at((start + bit) / 8) ^= static_cast<std::uint8_t>(0x80U >> ((start + bit) % 8));
                }
            }
            passed += passes(frame) ? 1 : 0;
        }
    }
    LONGS_EQUAL(0, passed);
}
