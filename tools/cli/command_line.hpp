// The command line as the subcommands describe it: what they need of CLI11, which is compiled once, in
// command_line.cpp. Option and CommandLine are handles: copying one is cheap and names the same thing.
#pragma once

#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11 names it
class App;
class Option;
}  // namespace CLI

namespace wheelwright::tools {

// Judges the text of one value.
struct Check {
    std::function<std::string(const std::string& text)> complaint;  // empty: the value is good
    std::string shown;  // what --help says of the value; may be empty
};

Check one_of(std::initializer_list<const char*> names);
Check existing_folder();
// Numbers, NaN and infinity refused; the complaint says in plain words what is expected.
Check greater_than_zero();  // and up to what no clock or robot reaches, so that nothing overflows
Check from_to(const std::string& low, const std::string& high);  // the bounds are printed as written here

class Option {
  public:
    explicit Option(CLI::Option& option) : option_(&option) {}
    Option required() const;
    Option show_default() const;  // in --help, as the value stands now
    Option check(const Check& check) const;
    Option values(int least, int most) const;  // how many follow the name
    Option delimiter(char between) const;      // splits one word into several values
    Option excludes(Option other) const;
    Option needs(Option other) const;

  private:
    CLI::Option* option_;
};

class CommandLine {
  public:
    explicit CommandLine(CLI::App& app) : app_(&app) {}

    // `value` is written when the line is understood, and must live until then. A name without dashes is a
    // positional argument. command_line.cpp lists the types of values.
    template <typename Value>
    Option add_option(const std::string& name, Value& value, const std::string& text) const;
    Option add_flag(const std::string& name, bool& value, const std::string& text) const;
    CommandLine add_subcommand(const std::string& name, const std::string& text) const;

    void footer(const std::string& text) const;
    void callback(std::function<void()> chosen) const;
    void require_subcommand() const;
    void fallthrough() const;  // the parent's options may stand behind this subcommand too

  private:
    CLI::App* app_;
};

// A whole program's command line.
class Program {
  public:
    // `version`: what --version says behind the name.
    Program(const std::string& name, const std::string& text, const std::string& version);
    ~Program();
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;

    CommandLine line() const { return CommandLine(*app_); }
    // Reads the line and calls the chosen callbacks. A value: the exit status, as it ends here, after --help
    // or with what is wrong on standard error.
    std::optional<int> parse(int argc, const char* const* argv) const;

  private:
    std::unique_ptr<CLI::App> app_;
};

}  // namespace wheelwright::tools
