// The few things we ask of libgpiod, whose versions 1 and 2 have nothing in common. Each is one small file,
// gpiod_api_1.cpp and gpiod_api_2.cpp; the build takes the one for the version it finds, or
// gpiod_api_none.cpp.
#pragma once

#include <memory>

#include "hal/linux/gpiod_line.hpp"

namespace wheelwright::hal::gpiod_api {

class Line {
  public:
    virtual ~Line() = default;
    virtual int get() = 0;  // 1 active, 0 inactive, -1 cannot be read
    virtual bool set(bool active) = 0;
};

enum class Step { none, open_chip, find_line, request_line, no_library };

// A line, or the step that failed and its errno.
struct Requested {
    std::unique_ptr<Line> line;
    Step failed = Step::none;
    int error = 0;
};

// `path` is the chip's device file.
Requested request(const char* path, const LineOptions& options, bool output);

}  // namespace wheelwright::hal::gpiod_api
