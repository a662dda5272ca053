#include "tools/gap/report/write_parameters.hpp"

#include <cstdio>
#include <optional>
#include <set>

#include "tools/cli/parameter_names.hpp"
#include "tools/ctl/link.hpp"

namespace wheelwright::gap {
namespace {

using tools::NamedParameter;

struct Write {
    NamedParameter parameter;
    double value = 0;
};

// In the changes' order, each effect made active before its numbers.
std::vector<Write> writes_of(const std::vector<task::FileChange>& changes) {
    std::vector<Write> all;
    std::set<std::string> active;
    for (const task::FileChange& change : changes) {
        const double* value = std::get_if<double>(&change.value);
        std::optional<NamedParameter> parameter = tools::find_named_parameter(std::string_view(change.key));
        if (value == nullptr || !parameter || parameter->when == model::ChangeWhen::start) continue;
        if (change.key.starts_with("effects.")) {
            const std::string key = change.key.substr(0, change.key.rfind('.')) + ".active";
            if (active.insert(key).second) {
                if (std::optional<NamedParameter> flag = tools::find_named_parameter(std::string_view(key))) {
                    all.push_back({std::move(*flag), 1});
                }
            }
        }
        all.push_back({std::move(*parameter), *value});
    }
    return all;
}

}  // namespace

int write_parameters(const std::vector<task::FileChange>& changes, const std::string& interface,
                     bool agreed) {
    using protocol::ParameterOperation;
    tools::LinkOptions options;
    options.interface = interface;
    options.program = "wheelwright gap";
    const std::vector<Write> writes = writes_of(changes);
    tools::catch_interrupt();
    tools::Link link(options);
    if (const int status = link.open(); status != tools::kDone) return status;
    int status = tools::kDone;
    const auto ask = [&](ParameterOperation what, const std::string& name, std::uint16_t index, float value) {
        const auto reply = link.ask(what, index, value, status);
        if (!reply) return 0.0F;
        if (reply->result != protocol::ParameterResult::ok) {
            status = options.complain(tools::kAimMissed, name + ": " + tools::result_text(reply->result));
        }
        return reply->value;
    };
    std::printf("\nTo be written on %s:\n", interface.c_str());
    for (const Write& write : writes) {
        const NamedParameter& p = write.parameter;
        const float old = ask(ParameterOperation::read, p.key, p.index, 0);
        if (status != tools::kDone) return status;
        const float now = tools::float_within(write.value, p.minimum, p.maximum);
        std::printf("  %-44s %s -> %s%s%s\n", p.key.c_str(), tools::parameter_value_text(p, old).c_str(),
                    tools::parameter_value_text(p, now).c_str(), p.unit.empty() ? "" : " ", p.unit.c_str());
    }
    if (!agreed) {
        std::printf("Write this to the robot, and to its robot file? [y/N] ");
        std::fflush(stdout);
        if (const int answer = std::getchar(); answer != 'y' && answer != 'Y') {
            return options.complain(tools::kAimMissed, "nothing was written");
        }
    }
    for (const Write& write : writes) {
        const NamedParameter& p = write.parameter;
        ask(ParameterOperation::write, p.key, p.index,
            tools::float_within(write.value, p.minimum, p.maximum));
        if (status != tools::kDone) break;
    }
    if (status == tools::kDone) ask(ParameterOperation::commit, "commit", 0, 0);
    if (status == tools::kDone) ask(ParameterOperation::save, "save", 0, 0);
    if (status == tools::kDone) {
        std::printf("Written, in force and saved.\n");
    } else {
        int ignored = tools::kDone;
        link.ask(ParameterOperation::discard, 0, 0, ignored);
    }
    tools::Link::leave_slot();
    return status;
}

}  // namespace wheelwright::gap
