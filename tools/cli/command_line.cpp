#include "tools/cli/command_line.hpp"

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "tools/cli/command.hpp"

namespace wheelwright::tools {
namespace {

template <typename Good>
Check number_check(const std::string& expected, Good good) {
    const auto complaint = [expected, good](const std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        if (!text.empty() && *end == '\0' && good(value)) return std::string();
        return "found " + text + ", expected a number " + expected;
    };
    return {complaint, ""};
}

// One of CLI11's own.
Check check_of(CLI::Validator validator) {
    std::string shown = validator.get_description();
    return {[validator = std::move(validator)](const std::string& text) { return validator(text); },
            std::move(shown)};
}

}  // namespace

Check one_of(std::initializer_list<const char*> names) {
    return check_of(CLI::IsMember(std::vector<std::string>(names.begin(), names.end())));
}

Check existing_folder() { return check_of(CLI::ExistingDirectory); }

Check greater_than_zero() {
    return number_check("greater than 0", [](double value) { return value > 0 && value <= 1e9; });
}

Check from_to(const std::string& low, const std::string& high) {
    const double least = std::stod(low);
    const double most = std::stod(high);
    return number_check("from " + low + " to " + high,
                        [=](double value) { return value >= least && value <= most; });
}

Option Option::required() const {
    option_->required();
    return *this;
}

Option Option::show_default() const {
    option_->capture_default_str();
    return *this;
}

Option Option::check(const Check& check) const {
    option_->check(check.complaint, check.shown);
    return *this;
}

Option Option::values(int least, int most) const {
    option_->expected(least, most);
    return *this;
}

Option Option::delimiter(char between) const {
    option_->delimiter(between);
    return *this;
}

Option Option::excludes(Option other) const {
    option_->excludes(other.option_);
    return *this;
}

Option Option::needs(Option other) const {
    option_->needs(other.option_);
    return *this;
}

template <typename Value>
Option CommandLine::add_option(const std::string& name, Value& value, const std::string& text) const {
    return Option(*app_->add_option(name, value, text));
}

template Option CommandLine::add_option(const std::string&, std::string&, const std::string&) const;
template Option CommandLine::add_option(const std::string&, double&, const std::string&) const;
template Option CommandLine::add_option(const std::string&, float&, const std::string&) const;
template Option CommandLine::add_option(const std::string&, int&, const std::string&) const;
template Option CommandLine::add_option(const std::string&, std::int64_t&, const std::string&) const;
template Option CommandLine::add_option(const std::string&, std::uint64_t&, const std::string&) const;
template Option CommandLine::add_option(const std::string&, std::vector<std::string>&,
                                        const std::string&) const;
template Option CommandLine::add_option(const std::string&, std::vector<double>&, const std::string&) const;

Option CommandLine::add_flag(const std::string& name, bool& value, const std::string& text) const {
    return Option(*app_->add_flag(name, value, text));
}

CommandLine CommandLine::add_subcommand(const std::string& name, const std::string& text) const {
    return CommandLine(*app_->add_subcommand(name, text));
}

void CommandLine::footer(const std::string& text) const { app_->footer(text); }

void CommandLine::callback(std::function<void()> chosen) const { app_->callback(std::move(chosen)); }

void CommandLine::require_subcommand() const { app_->require_subcommand(1); }

void CommandLine::fallthrough() const { app_->fallthrough(); }

Program::Program(const std::string& name, const std::string& text, const std::string& version)
    : app_(std::make_unique<CLI::App>(text)) {
    app_->name(name);
    app_->set_version_flag("--version", name + " " + version, "Print version and build, and exit");
}

Program::~Program() = default;

std::optional<int> Program::parse(int argc, const char* const* argv) const {
    try {
        app_->parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        // 0 for --help, whose text goes to standard output
        return app_->exit(error) == 0 ? kDone : kUsage;
    }
    return std::nullopt;
}

}  // namespace wheelwright::tools
