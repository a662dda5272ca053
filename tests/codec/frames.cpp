// Emits random frames with what the generated code makes of them, for compare_with_canmatrix.py to judge.
//     frames SEED COUNT
// prints, COUNT times for each message of each DBC, in turn
//     DBC MESSAGE encode HEX field...         HEX is what encode() made of the fields
//     DBC MESSAGE decode HEX STATUS field...  fields only when STATUS is ok
// A field is SIGNAL=NUMBER, or SIGNAL=NUMBER:LABEL for an enumeration. Numbers read back exactly.
// Exit status 1: some encoded frame does not decode to what encodes to the same bytes again.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>
#include <span>
#include <string_view>
#include <type_traits>

#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"

namespace {

using wheelwright::protocol::CodecStatus;
using wheelwright::protocol::FieldInfo;
using Bytes = std::span<const std::uint8_t>;

class Frames {
  public:
    explicit Frames(std::uint64_t seed) : random_(seed) {}

    template <typename Message>
    void emit(std::string_view dbc) {
        emit_encoded<Message>(dbc);
        emit_decoded<Message>(dbc);
    }

    bool consistent() const { return consistent_; }

  private:
    std::uint64_t bits(std::uint64_t count) { return random_() % count; }

    template <typename Field>
    void randomise(const FieldInfo& info, Field& field) {
        if constexpr (std::is_enum_v<Field>) {
            do {
                field = static_cast<Field>(bits(static_cast<std::uint64_t>(info.maximum) + 1));
            } while (!is_known(field) || static_cast<double>(field) < info.minimum);
        } else if constexpr (std::is_same_v<Field, bool>) {
            field = bits(2) != 0;
        } else if constexpr (std::is_same_v<Field, float>) {
            do {
                field = std::bit_cast<float>(static_cast<std::uint32_t>(random_()));
            } while (!(field >= info.minimum && field <= info.maximum));
        } else if constexpr (std::is_same_v<Field, double>) {
            const double part = static_cast<double>(bits(1U << 30U)) / ((1U << 30U) - 1.0);
            const std::array<double, 4> choices{info.minimum, info.maximum, 0.0,
                                                info.minimum + part * (info.maximum - info.minimum)};
            field = choices.at(std::min<std::uint64_t>(bits(20), 3));
        } else {
            field = static_cast<Field>(bits(static_cast<std::uint64_t>(info.maximum) + 1));
        }
    }

    template <typename Message>
    static void print(const Message& message) {
        Message::for_each_field(message, [](const FieldInfo& info, const auto& field) {
            using Field = std::remove_cvref_t<decltype(field)>;
            std::printf(" %.*s=%.17g", static_cast<int>(info.signal.size()), info.signal.data(),
                        static_cast<double>(field));
            if constexpr (std::is_enum_v<Field>) {
                const std::string_view label = to_string_view(field);
                std::printf(":%.*s", static_cast<int>(label.size()), label.data());
            }
        });
        std::printf("\n");
    }

    static void print(std::string_view dbc, std::string_view message, const char* what, Bytes bytes) {
        std::printf("%.*s %.*s %s ", static_cast<int>(dbc.size()), dbc.data(),
                    static_cast<int>(message.size()), message.data(), what);
        for (const std::uint8_t byte : bytes) std::printf("%02X", byte);
        if (bytes.empty()) std::printf("-");
    }

    template <typename Message>
    std::array<std::uint8_t, 8> random_message(Message& message) {
        Message::for_each_field(message,
                                [this](const FieldInfo& info, auto& field) { randomise(info, field); });
        std::array<std::uint8_t, 8> bytes{};
        consistent_ &= message.encode(bytes) == CodecStatus::ok;
        return bytes;
    }

    template <typename Message>
    void emit_encoded(std::string_view dbc) {
        Message message;
        const auto bytes = random_message(message);
        print(dbc, Message::name, "encode", Bytes(bytes).first(Message::length));
        print(message);

        Message decoded;
        std::array<std::uint8_t, 8> again{};
        consistent_ &= Message::decode(Bytes(bytes).first(Message::length), decoded) == CodecStatus::ok &&
                       decoded.encode(again) == CodecStatus::ok && again == bytes;
    }

    // Frames of four kinds: a legal one with one bit flipped, random bytes, random bytes with a run of ones
    // (which makes NaN), and, seldom, another length.
    template <typename Message>
    void emit_decoded(std::string_view dbc) {
        Message message;
        std::array<std::uint8_t, 8> bytes = random_message(message);
        const std::uint64_t kind = bits(4);
        if (kind == 0) {
            const std::uint64_t bit = bits(64);
            bytes.at(bit / 8) ^= static_cast<std::uint8_t>(1U << (bit % 8));
        } else if (kind < 3) {
            for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random_());
            const std::uint64_t first = bits(8);
            const std::uint64_t last = kind == 2 ? first + bits(9 - first) : first;
            for (std::uint64_t i = first; i < last; ++i) bytes.at(i) = 0xFF;
        }
        const std::size_t length = bits(8) == 0 ? bits(9) : Message::length;
        const Bytes frame = Bytes(bytes).first(length);
        const CodecStatus status = Message::decode(frame, message);
        print(dbc, Message::name, "decode", frame);
        std::printf(" %.*s", static_cast<int>(to_string_view(status).size()), to_string_view(status).data());
        if (status == CodecStatus::ok) {
            print(message);
        } else {
            std::printf("\n");
        }
    }

    std::mt19937_64 random_;
    bool consistent_ = true;
};

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: frames SEED COUNT\n");
        return 2;
    }
    Frames frames(std::strtoull(argv[1], nullptr, 10));
    const std::uint64_t count = std::strtoull(argv[2], nullptr, 10);
    for (std::uint64_t i = 0; i < count; ++i) {
        wheelwright::protocol::AllMessages::for_each([&]<typename M>() { frames.emit<M>("wheelwright"); });
        wheelwright::drivers::odrive_0_5::AllMessages::for_each(
            [&]<typename M>() { frames.emit<M>("odrive_0_5"); });
        wheelwright::drivers::odrive_0_6::AllMessages::for_each(
            [&]<typename M>() { frames.emit<M>("odrive_0_6"); });
    }
    return frames.consistent() ? 0 : 1;
}
