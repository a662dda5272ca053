// CRC-8 SAE J1850: polynomial 0x1D, start value 0xFF, final exclusive-or 0xFF, most significant bit first.
// In a CAN frame it detects every error of one or two bits and every burst of up to 8 bits.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace wheelwright::protocol {

inline constexpr std::array<std::uint8_t, 256> crc8_table = [] {
    std::array<std::uint8_t, 256> table{};
    for (unsigned byte = 0; byte < table.size(); ++byte) {
        unsigned remainder = byte;
        for (int bit = 0; bit < 8; ++bit) {
            remainder = (remainder << 1U) ^ ((remainder & 0x80U) != 0 ? 0x1DU : 0U);
        }
        table[byte] = static_cast<std::uint8_t>(remainder);
    }
    return table;
}();

// Cost: about four instructions a byte.
constexpr std::uint8_t crc8_sae_j1850(std::span<const std::uint8_t> bytes) {
    std::uint8_t crc = 0xFF;
    for (const std::uint8_t byte : bytes) {
        crc = crc8_table[static_cast<std::size_t>(crc ^ byte)];
    }
    return static_cast<std::uint8_t>(crc ^ 0xFFU);
}

}  // namespace wheelwright::protocol
