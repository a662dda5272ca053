// The bytes of an object, for a copy of its state (firmware/task/black_box.hpp).
#pragma once

#include <cstddef>
#include <span>

namespace wheelwright::hal {

// From the member `first` to the end of its object. Between them there are plain values only: no pointer, no
// reference, nothing that owns anything. What an object is wired to stands before `first`.
template <typename Member, typename Object>
std::span<std::byte> plain_memory(Member& first, Object& object) {
    auto* const begin = reinterpret_cast<std::byte*>(&first);
    auto* const end = reinterpret_cast<std::byte*>(&object) + sizeof(Object);
    return {begin, static_cast<std::size_t>(end - begin)};
}

}  // namespace wheelwright::hal
