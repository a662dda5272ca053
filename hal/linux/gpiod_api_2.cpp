// libgpiod 2.x.
#include <gpiod.h>

#include <cerrno>

#include "hal/linux/gpiod_api.hpp"

namespace wheelwright::hal::gpiod_api {

namespace {

class Line2 final : public Line {
  public:
    Line2(gpiod_line_request* request, unsigned offset) : request_(request), offset_(offset) {}
    ~Line2() override { gpiod_line_request_release(request_); }
    Line2(const Line2&) = delete;
    Line2& operator=(const Line2&) = delete;

    int get() override { return gpiod_line_request_get_value(request_, offset_); }
    bool set(bool active) override {
        return gpiod_line_request_set_value(
                   request_, offset_, active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE) == 0;
    }

  private:
    gpiod_line_request* request_;
    unsigned offset_;
};

gpiod_line_bias bias_of(LineBias bias) {
    switch (bias) {
        case LineBias::disabled:
            return GPIOD_LINE_BIAS_DISABLED;
        case LineBias::pull_up:
            return GPIOD_LINE_BIAS_PULL_UP;
        case LineBias::pull_down:
            return GPIOD_LINE_BIAS_PULL_DOWN;
        case LineBias::as_is:
            break;
    }
    return GPIOD_LINE_BIAS_AS_IS;
}

template <typename T>
using Owned = std::unique_ptr<T, void (*)(T*)>;

}  // namespace

Requested request(const char* path, const LineOptions& options, bool output) {
    const Owned<gpiod_chip> chip(gpiod_chip_open(path), gpiod_chip_close);
    if (!chip) {
        return {nullptr, Step::open_chip, errno};
    }
    const Owned<gpiod_line_info> info(gpiod_chip_get_line_info(chip.get(), options.offset),
                                      gpiod_line_info_free);
    if (!info) {
        return {nullptr, Step::find_line, errno};
    }
    const Owned<gpiod_line_settings> settings(gpiod_line_settings_new(), gpiod_line_settings_free);
    const Owned<gpiod_line_config> lines(gpiod_line_config_new(), gpiod_line_config_free);
    const Owned<gpiod_request_config> who(gpiod_request_config_new(), gpiod_request_config_free);
    if (!settings || !lines || !who) {
        return {nullptr, Step::request_line, ENOMEM};
    }
    gpiod_request_config_set_consumer(who.get(), options.consumer.c_str());
    gpiod_line_settings_set_active_low(settings.get(), options.active_low);
    const unsigned offset = options.offset;
    if (gpiod_line_settings_set_direction(
            settings.get(), output ? GPIOD_LINE_DIRECTION_OUTPUT : GPIOD_LINE_DIRECTION_INPUT) != 0 ||
        gpiod_line_settings_set_bias(settings.get(), bias_of(options.bias)) != 0 ||
        gpiod_line_settings_set_output_value(
            settings.get(), options.initially_active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE) !=
            0 ||
        gpiod_line_config_add_line_settings(lines.get(), &offset, 1, settings.get()) != 0) {
        return {nullptr, Step::request_line, errno};
    }
    gpiod_line_request* request = gpiod_chip_request_lines(chip.get(), who.get(), lines.get());
    if (request == nullptr) {
        return {nullptr, Step::request_line, errno};
    }
    return {std::make_unique<Line2>(request, offset), Step::none, 0};
}

}  // namespace wheelwright::hal::gpiod_api
