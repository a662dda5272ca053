// The error paths of the line through libgpiod 1, the library being replaced by what stands here.
#include <gpiod.h>

#include <cerrno>
#include <string>

#include "hal/linux/gpiod_line.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;

namespace {

struct FakeLibrary {
    int open_error = 0;
    int line_error = 0;
    int request_error = 0;
    int value = 0;
    bool set_works = true;
    // What was asked.
    std::string path;
    std::string consumer;
    unsigned offset = 0;
    int flags = 0;
    int initial = -1;
    int written = -1;
    int open_chips = 0;
    int held_lines = 0;
};

FakeLibrary* fake = nullptr;  // of the test that runs

// The library's types are opaque, so any address will do.
int chip_place = 0;
int line_place = 0;

int refuse_or_hold(int error) {
    if (error != 0) {
        errno = error;
        return -1;
    }
    ++fake->held_lines;
    return 0;
}

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

extern "C" {

gpiod_chip* gpiod_chip_open(const char* path) {
    fake->path = path;
    if (fake->open_error != 0) {
        errno = fake->open_error;
        return nullptr;
    }
    ++fake->open_chips;
    return reinterpret_cast<gpiod_chip*>(&chip_place);
}

void gpiod_chip_close(gpiod_chip* /*chip*/) {
    --fake->open_chips;
    errno = EBADF;  // whoever reads errno after closing reads nonsense
}

gpiod_line* gpiod_chip_get_line(gpiod_chip* /*chip*/, unsigned int offset) {
    fake->offset = offset;
    if (fake->line_error != 0) {
        errno = fake->line_error;
        return nullptr;
    }
    return reinterpret_cast<gpiod_line*>(&line_place);
}

int gpiod_line_request_input_flags(gpiod_line* /*line*/, const char* consumer, int flags) {
    fake->consumer = consumer;
    fake->flags = flags;
    return refuse_or_hold(fake->request_error);
}

int gpiod_line_request_output_flags(gpiod_line* /*line*/, const char* consumer, int flags, int initial) {
    fake->consumer = consumer;
    fake->flags = flags;
    fake->initial = initial;
    return refuse_or_hold(fake->request_error);
}

int gpiod_line_get_value(gpiod_line* /*line*/) { return fake->value; }

int gpiod_line_set_value(gpiod_line* /*line*/, int value) {
    fake->written = value;
    return fake->set_works ? 0 : -1;
}

void gpiod_line_release(gpiod_line* /*line*/) { --fake->held_lines; }

}  // extern "C"

TEST_GROUP(GpiodLine) {
    FakeLibrary library;
    hal::LineOptions options;

    void setup() override {
        fake = &library;
        options.chip = "gpiochip2";
        options.offset = 5;
    }
    void teardown() override {
        LONGS_EQUAL(0, library.open_chips);
        LONGS_EQUAL(0, library.held_lines);
        fake = nullptr;
    }
};

TEST(GpiodLine, a_name_is_a_device_and_a_path_stays_one) {
    CHECK(hal::open_input(options).has_value());
    STRCMP_EQUAL("/dev/gpiochip2", library.path.c_str());
    LONGS_EQUAL(5, library.offset);
    STRCMP_EQUAL("wheelwright", library.consumer.c_str());
    options.chip = "/dev/gpio/by-name/stop";
    CHECK(hal::open_input(options).has_value());
    STRCMP_EQUAL("/dev/gpio/by-name/stop", library.path.c_str());
}

TEST(GpiodLine, polarity_and_bias_are_asked_of_the_kernel) {
    LONGS_EQUAL(0, library.flags);
    options.active_low = true;
    options.bias = hal::LineBias::pull_up;
    CHECK(hal::open_input(options).has_value());
    LONGS_EQUAL(GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW | GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP, library.flags);
    options.active_low = false;
    options.bias = hal::LineBias::pull_down;
    CHECK(hal::open_output(options).has_value());
    LONGS_EQUAL(GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN, library.flags);
    options.bias = hal::LineBias::disabled;
    CHECK(hal::open_output(options).has_value());
    LONGS_EQUAL(GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE, library.flags);
}

TEST(GpiodLine, a_level_that_cannot_be_read_is_unknown) {
    auto input = hal::open_input(options);
    CHECK(input.has_value());
    library.value = 1;
    CHECK(input.value()->read() == hal::LineLevel::active);
    library.value = 0;
    CHECK(input.value()->read() == hal::LineLevel::inactive);
    library.value = -1;
    CHECK(input.value()->read() == hal::LineLevel::unknown);
}

TEST(GpiodLine, an_output_starts_as_asked_and_says_when_it_cannot_be_driven) {
    options.initially_active = true;
    auto output = hal::open_output(options);
    CHECK(output.has_value());
    LONGS_EQUAL(1, library.initial);
    CHECK(output.value()->write(false));
    LONGS_EQUAL(0, library.written);
    CHECK(output.value()->write(true));
    LONGS_EQUAL(1, library.written);
    library.set_works = false;
    CHECK(!output.value()->write(false));
}

TEST(GpiodLine, each_reason_not_to_open_is_named_with_its_remedy_and_nothing_stays_open) {
    struct Case {
        int open_error, line_error, request_error;
        const char* word;
        const char* remedy;
        int exit_status;
    };
    const Case cases[] = {
        {ENOENT, 0, 0, "no GPIO chip /dev/gpiochip2", "gpiodetect", 4},
        {EACCES, 0, 0, "No permission", "group", 4},
        {ENOTTY, 0, 0, "not a GPIO chip", "gpiodetect", 4},
        {EMFILE, 0, 0, "/dev/gpiochip2", "open files", 4},
        {0, EINVAL, 0, "no line 5 of /dev/gpiochip2", "gpioinfo", 1},
        {0, 0, EBUSY, "Somebody else", "gpioinfo", 4},
        {0, 0, EPERM, "No permission", "root", 4},
        {0, 0, EIO, "line 5 of /dev/gpiochip2", "error", 4},
    };
    for (const Case& one : cases) {
        library.open_error = one.open_error;
        library.line_error = one.line_error;
        library.request_error = one.request_error;
        const auto input = hal::open_input(options);
        const auto output = hal::open_output(options);
        CHECK(!input);
        CHECK(!output);
        CHECK(contains(input.error().message, one.word));
        CHECK(contains(input.error().message, one.remedy));
        LONGS_EQUAL(one.exit_status, input.error().exit_status());
        STRCMP_EQUAL(input.error().message.c_str(), output.error().message.c_str());
        LONGS_EQUAL(0, library.open_chips);
    }
}
