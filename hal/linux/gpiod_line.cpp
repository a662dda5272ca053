#include "hal/linux/gpiod_line.hpp"

#include <cerrno>
#include <system_error>
#include <utility>

#include "hal/linux/gpiod_api.hpp"

namespace wheelwright::hal {

namespace {

using gpiod_api::Step;

class GpiodInput final : public DigitalInput {
  public:
    explicit GpiodInput(std::unique_ptr<gpiod_api::Line> line) : line_(std::move(line)) {}

    LineLevel read() override {
        switch (line_->get()) {
            case 0:
                return LineLevel::inactive;
            case 1:
                return LineLevel::active;
            default:
                return LineLevel::unknown;
        }
    }

  private:
    std::unique_ptr<gpiod_api::Line> line_;
};

class GpiodOutput final : public DigitalOutput {
  public:
    explicit GpiodOutput(std::unique_ptr<gpiod_api::Line> line) : line_(std::move(line)) {}

    bool write(bool active) override { return line_->set(active); }

  private:
    std::unique_ptr<gpiod_api::Line> line_;
};

Error explain(Step step, int error, const std::string& path, unsigned offset) {
    const std::string line = "line " + std::to_string(offset) + " of " + path;
    const std::string reason = std::generic_category().message(error);
    const bool forbidden = error == EACCES || error == EPERM;
    switch (step) {
        case Step::no_library:
            return {
                "Built without libgpiod, so " + line +
                " cannot be used; install libgpiod-dev and build again, or take the line out of the robot "
                "file."};
        case Step::open_chip:
            if (error == ENOENT) {
                return {"There is no GPIO chip " + path + "; `gpiodetect` lists those there are."};
            }
            if (forbidden) {
                return {"No permission to open " + path +
                        "; join the group that owns it (often gpio), or run as "
                        "root."};
            }
            if (error == ENOTTY || error == ENODEV || error == EINVAL) {
                return {path + " is not a GPIO chip; `gpiodetect` lists those there are."};
            }
            return {"Cannot open " + path + ": " + reason + "."};
        case Step::find_line:
            if (error == EINVAL) {
                return {"There is no " + line + "; `gpioinfo` lists those there are.", Error::Kind::usage};
            }
            return {"Cannot look up " + line + ": " + reason + "."};
        default:
            if (error == EBUSY) {
                return {"Somebody else uses " + line + "; `gpioinfo` shows who."};
            }
            if (forbidden) {
                return {"No permission to use " + line + "; run as root, or ask the line's owner."};
            }
            return {"Cannot use " + line + ": " + reason + "."};
    }
}

template <typename Interface, typename Implementation>
Result<std::unique_ptr<Interface>> open(const LineOptions& options, bool output) {
    const bool is_path = options.chip.find('/') != std::string::npos;
    const std::string path = is_path ? options.chip : "/dev/" + options.chip;
    gpiod_api::Requested requested = gpiod_api::request(path.c_str(), options, output);
    if (!requested.line) {
        return explain(requested.failed, requested.error, path, options.offset);
    }
    return std::unique_ptr<Interface>(std::make_unique<Implementation>(std::move(requested.line)));
}

}  // namespace

Result<std::unique_ptr<DigitalInput>> open_input(const LineOptions& options) {
    return open<DigitalInput, GpiodInput>(options, false);
}

Result<std::unique_ptr<DigitalOutput>> open_output(const LineOptions& options) {
    return open<DigitalOutput, GpiodOutput>(options, true);
}

}  // namespace wheelwright::hal
