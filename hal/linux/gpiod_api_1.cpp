// libgpiod 1.x (written against 1.6).
#include <gpiod.h>

#include <cerrno>

#include "hal/linux/gpiod_api.hpp"

namespace wheelwright::hal::gpiod_api {

namespace {

class Line1 final : public Line {
  public:
    Line1(gpiod_chip* chip, gpiod_line* line) : chip_(chip), line_(line) {}
    ~Line1() override {
        gpiod_line_release(line_);
        gpiod_chip_close(chip_);
    }
    Line1(const Line1&) = delete;
    Line1& operator=(const Line1&) = delete;

    int get() override { return gpiod_line_get_value(line_); }
    bool set(bool active) override { return gpiod_line_set_value(line_, active ? 1 : 0) == 0; }

  private:
    gpiod_chip* chip_;
    gpiod_line* line_;
};

int flags_of(const LineOptions& options) {
    int flags = options.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0;
    switch (options.bias) {
        case LineBias::as_is:
            break;
        case LineBias::disabled:
            flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
            break;
        case LineBias::pull_up:
            flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
            break;
        case LineBias::pull_down:
            flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
            break;
    }
    return flags;
}

}  // namespace

Requested request(const char* path, const LineOptions& options, bool output) {
    gpiod_chip* chip = gpiod_chip_open(path);
    if (chip == nullptr) {
        return {nullptr, Step::open_chip, errno};
    }
    gpiod_line* line = gpiod_chip_get_line(chip, options.offset);
    if (line == nullptr) {
        const int error = errno;
        gpiod_chip_close(chip);
        return {nullptr, Step::find_line, error};
    }
    const char* consumer = options.consumer.c_str();
    const int flags = flags_of(options);
    const int refused =
        output ? gpiod_line_request_output_flags(line, consumer, flags, options.initially_active ? 1 : 0)
               : gpiod_line_request_input_flags(line, consumer, flags);
    if (refused != 0) {
        const int error = errno;
        gpiod_chip_close(chip);
        return {nullptr, Step::request_line, error};
    }
    return {std::make_unique<Line1>(chip, line), Step::none, 0};
}

}  // namespace wheelwright::hal::gpiod_api
