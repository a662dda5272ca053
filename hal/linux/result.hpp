// A value, or why there is none. For start-up: it may allocate.
#pragma once

#include <string>
#include <utility>
#include <variant>

namespace wheelwright::hal {

// One sentence for the person in front of the machine: what is wrong, and what to do about it.
struct Error {
    // The exit status that a program gives for it.
    enum class Kind {
        usage = 1,    // the request makes no sense on any machine
        machine = 4,  // this machine lacks something: a device, a kernel part, a permission
    };

    std::string message;
    Kind kind = Kind::machine;

    int exit_status() const { return static_cast<int>(kind); }
};

template <typename T>
class Result {
  public:
    Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}      // NOLINT(*-explicit-*)
    Result(Error error) : content_(std::in_place_index<1>, std::move(error)) {}  // NOLINT(*-explicit-*)

    bool has_value() const { return content_.index() == 0; }
    explicit operator bool() const { return has_value(); }

    // value() only when true, error() only when false; otherwise std::bad_variant_access is thrown.
    T& value() { return std::get<0>(content_); }
    const T& value() const { return std::get<0>(content_); }
    const Error& error() const { return std::get<1>(content_); }

  private:
    std::variant<T, Error> content_;
};

}  // namespace wheelwright::hal
