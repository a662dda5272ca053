// Any bytes as any message of the three DBC files: refused, or decoded to what encodes to the same bytes, and
// to fields within the ranges that the DBC gives.
#include <algorithm>
#include <array>
#include <span>
#include <type_traits>

#include "drivers/odrive/odrive_0_5_messages.hpp"
#include "drivers/odrive/odrive_0_6_messages.hpp"
#include "firmware/protocol/wheelwright_messages.hpp"
#include "tests/fuzz/expect.hpp"

using namespace wheelwright;

namespace {

struct Judge {
    std::span<const std::uint8_t> bytes;

    template <typename Message>
    void operator()() const {
        Message message;
        if (Message::decode(bytes, message) != protocol::CodecStatus::ok) return;
        std::array<std::uint8_t, 8> once{}, twice{};
        if (message.encode(once) != protocol::CodecStatus::ok) {
            // A drive's numbers are taken as they come, so they may lie outside what may be sent.
            return;
        }
        Message again;
        FUZZ_EXPECT(Message::decode(std::span(once).first(Message::length), again) ==
                    protocol::CodecStatus::ok);
        FUZZ_EXPECT(again.encode(twice) == protocol::CodecStatus::ok);
        FUZZ_EXPECT(once == twice);
    }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const Judge judge{{data, std::min<std::size_t>(size, 64)}};
    protocol::AllMessages::for_each(judge);
    drivers::odrive_0_5::AllMessages::for_each(judge);
    drivers::odrive_0_6::AllMessages::for_each(judge);
    return 0;
}
