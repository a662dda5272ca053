// Every state of the supervisor with every pair of events in one cycle, against two statements of the rules
// that know nothing of its tables: what must never happen (`Judge`), and what happens instead (`expected`).
#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <vector>

#include "firmware/supervisor/supervisor.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright::supervisor;

namespace {

bool one_of(Mode mode, std::initializer_list<Mode> list) {
    return std::find(list.begin(), list.end(), mode) != list.end();
}
bool driving(Mode mode) {
    return one_of(mode,
                  {Mode::torque, Mode::ident, Mode::velocity, Mode::pose, Mode::trajectory, Mode::adaptive});
}
bool has_setpoint(Mode mode) { return driving(mode); }  // or a host that must be there
bool has_loops(Mode mode) { return driving(mode) && mode != Mode::torque && mode != Mode::ident; }
bool has_path(Mode mode) { return mode == Mode::trajectory || mode == Mode::adaptive; }
bool emergency(Fault fault) {
    return fault == Fault::emergency_stop_line || fault == Fault::emergency_stop_message;
}

// A cycle's input, and what can be seen of the machine.
struct Input {
    Conditions now;
    Requests asked;
};
struct State {
    Mode mode = Mode::boot;
    Phase phase = Phase::steady;
    Mode requested = Mode::idle;
    Fault fault = Fault::none;
    Blocker blocker = Blocker::none;
    int age = 0;  // cycles in a phase that has a limit

    bool law() const { return phase == Phase::steady && driving(mode); }
    bool braking() const { return phase == Phase::ramping; }
    bool armed() const { return phase != Phase::steady || driving(mode); }
    std::uint32_t key() const {
        return unsigned(mode) | unsigned(phase) << 4U | unsigned(requested) << 8U | unsigned(fault) << 12U |
               unsigned(phase == Phase::steady ? 0 : age) << 20U;
    }
};
State seen(const Supervisor& s) { return {s.mode(), s.phase(), s.requested(), s.fault(), s.blocker()}; }

constexpr int kLimit = 2;                       // cycles for arming, and for a ramp
constexpr unsigned kReactions = 32, kKey = 32;  // choices: each reaction is a bit, and that there is a key

SupervisorConfig config_of(unsigned choices) {
    SupervisorConfig c;
    c.arming_limit_cycles = c.ramp_limit_cycles = kLimit;
    c.stops = {(choices & 1U) != 0, (choices & 2U) != 0,  (choices & 4U) != 0,
               (choices & 8U) != 0, (choices & 16U) != 0, std::popcount(choices) % 2 != 0};
    c.arming_needs_proof = (choices & kKey) != 0;
    return c;
}

// Braking needs drives that obey, eyes, a bus, numbers; and the leave of each reaction that was chosen.
bool may_brake(const Conditions& c, const StopChoices& may, bool with_setpoint) {
    const bool blind = c.feedback_stale || c.encoder_implausible || c.not_finite;
    const bool disobeyed = !c.drives_armed || c.drive_error || c.drive_silent || c.drive_disarmed_itself ||
                           c.torque_not_followed || c.drive_enable_failed || c.foreign_control || c.bus_down;
    const bool told_to_coast = ((c.stop_line_active || c.stop_message) && !may.emergency_stop_ramps) ||
                               (c.over_speed && !may.over_speed_ramps) || (c.overrun && !may.overrun_ramps) ||
                               (c.terminate && !may.terminate_ramps) || c.supply_high ||
                               ((c.supply_low || c.drive_overheated) && !may.drive_limits_ramp) ||
                               (c.command_stale && with_setpoint && !may.stale_command_ramps);
    return !blind && !disobeyed && !told_to_coast;
}

// What stops `mode` in this cycle, by the name that is told.
Fault danger(const Conditions& c, Mode mode, Phase phase) {
    const bool arming = phase == Phase::arming;
    if (mode == Mode::idle && !c.stop_message)
        return c.foreign_control ? Fault::foreign_control : Fault::none;
    if (mode != Mode::idle && c.stop_line_active) return Fault::emergency_stop_line;
    if (c.stop_message) return Fault::emergency_stop_message;
    if (c.not_finite) return Fault::internal_error;
    if (c.bus_down) return Fault::bus_down;
    if (c.overrun) return Fault::cycle_overrun;
    if (c.foreign_control) return Fault::foreign_control;
    if (c.drive_enable_failed) return Fault::drive_enable_failed;
    if (c.torque_not_followed) return Fault::torque_not_followed;
    if (c.drive_error && !arming) return Fault::drive_error;
    if (c.drive_silent) return Fault::drive_silent;
    if ((c.drive_disarmed_itself || !c.drives_armed) && !arming) return Fault::drive_left_armed_state;
    if (c.feedback_stale) return Fault::stale_feedback;
    if (c.encoder_implausible) return Fault::encoder_implausible;
    if (c.over_speed) return Fault::over_speed;
    if (c.supply_low || c.supply_high) return Fault::drive_voltage_out_of_range;
    if (c.drive_overheated) return Fault::drive_overheated;
    if (c.command_stale && phase == Phase::steady && has_setpoint(mode)) return Fault::stale_command;
    if (c.terminate) return Fault::terminated;
    return Fault::none;
}

Blocker in_the_way(const Conditions& c, Mode wanted, const State& s) {
    if (wanted != Mode::idle && !driving(wanted)) return Blocker::unknown_mode;
    if (s.mode == Mode::fault) return Blocker::fault_latched;
    if (wanted == Mode::idle) return Blocker::none;
    if (wanted == Mode::ident && s.mode != Mode::idle && s.mode != Mode::ident) return Blocker::not_idle;
    if (c.stop_line_active) return Blocker::stop_line_active;
    if (c.terminate) return Blocker::fault_latched;
    if (c.drive_silent) return Blocker::drives_not_armed;
    if (c.drive_error) return Blocker::drive_error;
    if (c.supply_low || c.supply_high || c.drive_overheated) return Blocker::drive_out_of_limits;
    if (wanted == Mode::ident && c.moving) return Blocker::robot_moving;
    if (has_loops(wanted) && !c.model_known) return Blocker::not_identified;
    if (has_loops(wanted) && !c.velocity_design_accepted) return Blocker::design_refused;
    if (wanted == Mode::adaptive && !c.model_trusted) return Blocker::model_not_trusted;
    return Blocker::none;
}

Blocker keeps_fault(const State& s, const Conditions& c) {
    if (s.braking()) return Blocker::robot_moving;
    if (c.terminate) return Blocker::fault_latched;
    if (c.moving) return Blocker::robot_moving;
    if (c.stop_line_active) return Blocker::stop_line_active;
    return c.bus_down || c.stop_message ? Blocker::fault_latched : Blocker::none;
}

// With a key, who holds it asks for what arms: nothing but idle, and what is under way, is to be had without.
bool must_prove(const Input& in, const State& s) {
    const Mode wanted = *in.asked.mode;
    return driving(wanted) && !driving(s.mode) && !(s.phase == Phase::arming && s.requested == wanted);
}

// The whole cycle in words.
State expected(State s, const Input& in, const StopChoices& may, bool key) {
    const Conditions& c = in.now;
    const auto change = [&s](Mode mode, Phase phase) {
        if (phase != s.phase || phase == Phase::steady) s.age = 0;
        s.mode = mode;
        s.phase = phase;
    };
    if (s.mode == Mode::boot) s.mode = Mode::idle;
    if (in.asked.clear_fault && s.mode == Mode::fault) {
        s.blocker = keeps_fault(s, c);
        if (s.blocker == Blocker::none) {
            change(Mode::idle, Phase::steady);
            s.fault = Fault::none;
        }
    }
    bool fresh = false;  // a mode is new in this cycle
    if (in.asked.mode) {
        const Mode wanted = *in.asked.mode;
        s.blocker = in_the_way(c, wanted, s);
        if (s.blocker == Blocker::none && key && !in.asked.proven && must_prove(in, s)) {
            s.blocker = Blocker::not_authenticated;
        }
        if (s.blocker == Blocker::none) {
            s.requested = wanted;
            if (wanted == Mode::idle) {
                change(s.mode, driving(s.mode) ? Phase::ramping : Phase::steady);
            } else if (!driving(s.mode)) {
                change(Mode::idle, Phase::arming);
            } else if (wanted != s.mode || s.phase != Phase::steady) {
                fresh = true;
                change(wanted, Phase::steady);
            }
        }
    }
    s.age = std::min(s.age + 1, kLimit + 1);

    if (s.mode == Mode::fault) {
        if (c.stop_line_active || c.stop_message) {
            s.fault = c.stop_line_active ? Fault::emergency_stop_line : Fault::emergency_stop_message;
        }
        if (!may_brake(c, may, false)) change(s.mode, Phase::steady);
    } else {
        const Mode watched = s.phase == Phase::arming ? s.requested : s.mode;
        const Fault fault = danger(c, watched, s.phase);
        if (fault != Fault::none) {
            s.fault = fault;
            s.requested = Mode::idle;
            const bool brakes =
                driving(s.mode) && may_brake(c, may, s.phase == Phase::steady && has_setpoint(s.mode));
            change(Mode::fault, brakes ? Phase::ramping : Phase::steady);
            return s;
        }
    }
    if (s.phase == Phase::arming) {
        if (c.arming_refused || s.age > kLimit) {
            s.blocker = !c.watchdog_confirmed       ? Blocker::watchdog_not_confirmed
                        : !c.control_mode_confirmed ? Blocker::control_mode_not_confirmed
                        : c.drive_error             ? Blocker::drive_error
                                                    : Blocker::drives_not_armed;
            change(Mode::fault, Phase::steady);
            s.fault = Fault::arming_refused;
            s.requested = Mode::idle;
        } else if (c.drives_armed && !c.drive_error && !c.drive_disarmed_itself &&
                   (c.path_known || !has_path(s.requested))) {
            s.blocker = in_the_way(c, s.requested, s);
            if (s.blocker != Blocker::none) s.requested = Mode::idle;
            change(s.requested, Phase::steady);
        }
    } else if (s.braking()) {
        if (!c.rolling || s.age > kLimit) {
            change(s.mode == Mode::fault ? Mode::fault : Mode::idle, Phase::steady);
        }
    } else if (driving(s.mode) && c.mode_finished && !fresh) {
        s.requested = Mode::idle;
        change(s.mode, Phase::ramping);
    }
    return s;
}

// --- events ---

constexpr std::array kConditions{&Conditions::feedback_stale,
                                 &Conditions::encoder_implausible,
                                 &Conditions::command_stale,
                                 &Conditions::drive_error,
                                 &Conditions::torque_not_followed,
                                 &Conditions::drive_enable_failed,
                                 &Conditions::foreign_control,
                                 &Conditions::supply_low,
                                 &Conditions::supply_high,
                                 &Conditions::drive_overheated,
                                 &Conditions::drive_silent,
                                 &Conditions::drives_armed,
                                 &Conditions::path_known,
                                 &Conditions::drive_disarmed_itself,
                                 &Conditions::arming_refused,
                                 &Conditions::watchdog_confirmed,
                                 &Conditions::control_mode_confirmed,
                                 &Conditions::over_speed,
                                 &Conditions::stop_line_active,
                                 &Conditions::stop_message,
                                 &Conditions::overrun,
                                 &Conditions::bus_down,
                                 &Conditions::not_finite,
                                 &Conditions::terminate,
                                 &Conditions::moving,
                                 &Conditions::rolling,
                                 &Conditions::model_known,
                                 &Conditions::velocity_design_accepted,
                                 &Conditions::model_trusted,
                                 &Conditions::mode_finished};
static_assert(sizeof(Conditions) == kConditions.size());  // all of them

constexpr std::size_t kModeRequests = kModeCount + 2;  // and two that do not exist
constexpr std::size_t kEvents = kConditions.size() + kModeRequests + 1;

void happen(std::size_t event, Input& in) {
    if (event < kConditions.size()) {
        bool& condition = in.now.*kConditions[event];
        condition = !condition;
    } else if (event < kConditions.size() + kModeRequests) {
        const std::size_t mode = event - kConditions.size();
        in.asked.mode = mode > kModeCount ? Mode{255} : static_cast<Mode>(mode);
    } else {
        in.asked.clear_fault = true;
    }
}

Input ordinary(bool armed, bool moving) {
    Input in;
    in.now.watchdog_confirmed = in.now.velocity_design_accepted = true;
    in.now.model_known = in.now.model_trusted = true;
    in.now.drives_armed = armed;
    in.now.moving = in.now.rolling = moving;
    return in;
}

// None, one and two events in a robot that rests or moves, with armed drives or without.
template <typename Visit>
void each_pair(Visit visit) {
    for (const bool armed : {true, false}) {
        for (const bool moving : {true, false}) {
            const Input plain = ordinary(armed, moving);
            visit(plain, 0);
            for (std::size_t a = 0; a < kEvents; ++a) {
                Input one = plain;
                happen(a, one);
                visit(one, 1);
                for (std::size_t b = a + 1; b < kEvents; ++b) {
                    Input two = one;
                    happen(b, two);
                    visit(two, 2);
                }
            }
        }
    }
}

struct Node {
    Supervisor machine;
    State state;
};

// --- what must never happen ---

class Judge {
  public:
    explicit Judge(const SupervisorConfig& config) : config_(config) {}

    void look(const State& before, const Input& in, const Supervisor& machine, const Verdict& verdict,
              const State& after, int events) {
        const Conditions& c = in.now;
        const bool line = c.stop_line_active;
        const bool stop = line || c.stop_message;
        const bool law = verdict.owner == Owner::law;
        const bool brake = verdict.owner == Owner::brake;

        rule(law == after.law() && brake == after.braking() && verdict.mode == after.mode,
             "the verdict is not the state");
        rule(!law || (driving(after.mode) && after.fault == Fault::none), "a law drives without a mode");
        rule(!brake || driving(after.mode) || after.mode == Mode::fault, "brakes where nothing drove");
        rule(verdict.owner == Owner::nobody || (c.drives_armed && verdict.armed),
             "torque outside an armed state");
        rule(!law || danger(c, after.mode, Phase::arming) == Fault::none, "drives on in danger");
        rule(!law || !has_setpoint(after.mode) || !c.command_stale || verdict.entry == Entry::from_rest,
             "drives on a set-point that is late");
        rule(!brake || may_brake(c, config_.stops, false), "brakes though it may not");

        // The line is a level: it needs no memory where arming is given up in the same cycle.
        const bool given_up = before.phase == Phase::arming && in.asked.mode == Mode::idle && !c.stop_message;
        const bool concerned = (before.armed() && !given_up) || before.mode == Mode::fault ||
                               driving(after.mode) || (c.stop_message && before.mode != Mode::boot);
        rule(!stop || !concerned || (after.mode == Mode::fault && emergency(after.fault)),
             "an emergency stop does not dominate");
        rule(!stop || !law, "an emergency stop lets a law drive");
        rule(!c.stop_message || verdict.order == DriveOrder::disarm || verdict.armed,
             "a stop message that disarms nothing");
        const bool may_clear = in.asked.clear_fault && keeps_fault(before, c) == Blocker::none;
        rule(!emergency(before.fault) || emergency(after.fault) || may_clear,
             "an emergency stop is forgotten");

        const bool cleared = before.mode == Mode::fault && after.mode != Mode::fault;
        rule(!cleared || (in.asked.clear_fault && !c.moving && !stop && !c.terminate && !c.bus_down &&
                          !before.braking()),
             "a fault left without leave");
        rule(before.mode != Mode::fault || after.mode != Mode::fault || after.fault == before.fault || stop ||
                 may_clear,
             "a fault changes its name");
        rule((after.mode == Mode::fault) == (after.fault != Fault::none), "a fault without a name");

        rule(!law || before.law() || verdict.entry != Entry::none, "a law goes on that was not entered");
        rule(!law || before.mode == after.mode || before.requested == after.mode ||
                 in.asked.mode == after.mode,
             "a mode nobody asked for");
        rule(verdict.entry == Entry::none || law, "entered and not driving");
        rule(!verdict.begins_braking || (brake && !before.braking()), "begins to brake twice");
        rule(verdict.refused == (in.asked.mode && in_the_way_was(before, in) != Blocker::none),
             "refused or not");
        // Whatever else is true, and whatever was asked before: what arms has been proven.
        rule(!config_.arming_needs_proof || !after.armed() || before.armed() || in.asked.proven,
             "armed without the key");
        rule(!config_.arming_needs_proof || !driving(after.mode) || after.mode == before.mode ||
                 driving(before.mode) || after.mode == before.requested || in.asked.proven,
             "another mode than was proven");

        const DriveOrder order = verdict.armed && !before.armed()   ? DriveOrder::arm
                                 : !verdict.armed && before.armed() ? DriveOrder::disarm
                                                                    : verdict.order;
        rule(verdict.order == order && (order != DriveOrder::arm || !before.armed()), "the drives' order");

        if (events == 1 && before.law() && !in.asked.mode) ramps_as_configured(in, before, brake);
        tells_the_remedy(machine, in, after);
    }

    static long violations;

  private:
    Blocker in_the_way_was(State s, const Input& in) const {
        if (in.asked.clear_fault && s.mode == Mode::fault && keeps_fault(s, in.now) == Blocker::none) {
            s.mode = Mode::idle;
        }
        if (s.mode == Mode::boot) s.mode = Mode::idle;
        const Blocker blocker = in_the_way(in.now, *in.asked.mode, s);
        const bool proven = !config_.arming_needs_proof || in.asked.proven || !must_prove(in, s);
        return blocker == Blocker::none && !proven ? Blocker::not_authenticated : blocker;
    }

    // One cause alone brakes if the robot file says so, and else coasts.
    void ramps_as_configured(const Input& in, const State& before, bool brake) {
        const Conditions& c = in.now;
        const StopChoices& may = config_.stops;
        if (!c.drives_armed || !c.moving || !c.rolling) return;
        const auto reacts = [&](bool cause, bool ramp, const char* what) {
            if (cause) rule(brake == ramp, what);
        };
        reacts(c.stop_line_active || c.stop_message, may.emergency_stop_ramps, "emergency stop: reaction");
        reacts(c.over_speed, may.over_speed_ramps, "over-speed: reaction");
        reacts(c.overrun, may.overrun_ramps, "overrun: reaction");
        reacts(c.terminate, may.terminate_ramps, "termination: reaction");
        reacts(c.supply_low || c.drive_overheated, may.drive_limits_ramp, "drives' limits: reaction");
        reacts(c.supply_high, false, "supply too high: reaction");
        reacts(c.command_stale && has_setpoint(before.mode), may.stale_command_ramps,
               "stale command: reaction");
    }

    // What Status says would clear the fault does, and nothing else.
    void tells_the_remedy(const Supervisor& machine, const Input& in, const State& after) {
        const Remedy remedy = machine.cleared_by();
        rule((after.mode == Mode::fault) == (remedy != Remedy::none), "a fault, and nothing clears it");
        if (after.mode != Mode::fault) return;
        Supervisor next = machine;
        Conditions c = in.now;
        c.stop_message = c.foreign_control = false;  // events of one cycle
        rule(next.step(c, {true, {}}).clear_drive_errors == (remedy == Remedy::clear_fault),
             "clear_fault does not clear");
    }

    void rule(bool holds, const char* what) {
        if (holds) return;
        if (++violations <= 20) std::printf("violated: %s\n", what);
    }

    SupervisorConfig config_;
};
long Judge::violations = 0;

// All states that can be reached, each once; visit(node, input, machine, verdict, after) for each pair.
template <typename Visit>
std::vector<Node> each_state(const SupervisorConfig& config, Visit visit) {
    std::vector<Node> nodes{{Supervisor(config), State{}}};
    std::vector<std::uint32_t> keys{nodes[0].state.key()};
    for (std::size_t i = 0; i < nodes.size(); ++i) {
        const Node node = nodes[i];
        const auto look = [&](const Input& in, int events) {
            Supervisor machine = node.machine;
            const Verdict verdict = machine.step(in.now, in.asked);
            const State after = visit(node, in, machine, verdict, events);
            if (std::find(keys.begin(), keys.end(), after.key()) == keys.end()) {
                keys.push_back(after.key());
                nodes.push_back({machine, after});
            }
        };
        each_pair([&](Input in, int events) {
            look(in, events);
            in.asked.proven = true;
            if (config.arming_needs_proof) look(in, events);
        });
    }
    return nodes;
}

bool same(const State& a, const State& b) {
    return a.mode == b.mode && a.phase == b.phase && a.requested == b.requested && a.fault == b.fault &&
           a.blocker == b.blocker;
}

std::vector<Node> states(unsigned choices) {
    const SupervisorConfig config = config_of(choices);
    return each_state(config, [&](const Node& node, const Input& in, const Supervisor&, const Verdict&, int) {
        return expected(node.state, in, config.stops, config.arming_needs_proof);
    });
}

}  // namespace

TEST_GROUP(SupervisorEnumeration){};

TEST(SupervisorEnumeration, every_state_with_every_pair_of_events) {
    long visits = 0;
    long wrong = 0;
    std::size_t most = 0;
    // With a key the reactions make no difference to what is asked: none, and all of them.
    std::vector<unsigned> all{kKey, kKey + kReactions - 1};
    for (unsigned choices = 0; choices < kReactions; ++choices) all.push_back(choices);
    for (const unsigned choices : all) {
        const SupervisorConfig config = config_of(choices);
        Judge judge(config);
        const auto nodes =
            each_state(config, [&](const Node& node, const Input& in, const Supervisor& machine,
                                   const Verdict& verdict, int events) {
                ++visits;
                const State after = expected(node.state, in, config.stops, config.arming_needs_proof);
                if (!same(after, seen(machine)) && ++wrong <= 5) {
                    const State got = seen(machine);
                    std::printf("mode %u phase %u fault %u: expected %u %u %u %u %u, is %u %u %u %u %u\n",
                                unsigned(node.state.mode), unsigned(node.state.phase),
                                unsigned(node.state.fault), unsigned(after.mode), unsigned(after.phase),
                                unsigned(after.requested), unsigned(after.fault), unsigned(after.blocker),
                                unsigned(got.mode), unsigned(got.phase), unsigned(got.requested),
                                unsigned(got.fault), unsigned(got.blocker));
                }
                judge.look(node.state, in, machine, verdict, seen(machine), events);
                return after;
            });
        most = std::max(most, nodes.size());
    }
    std::printf("%zu states, %ld visits; %ld not as expected, %ld violations\n", most, visits, wrong,
                Judge::violations);
    LONGS_EQUAL(0, wrong);
    LONGS_EQUAL(0, Judge::violations);
}

// Whatever is asked for in every cycle, and whatever else is true: torque ends within the ramp's limit.
TEST(SupervisorEnumeration, every_fault_reaches_zero_torque_and_keeps_it) {
    for (const unsigned choices : {0U, 31U}) {
        for (const Node& node : states(choices)) {
            if (node.state.mode != Mode::fault) continue;
            each_pair([&](const Input& in, int) {
                if (in.asked.clear_fault) return;
                Supervisor machine = node.machine;
                for (int i = 0; i <= kLimit; ++i) machine.step(in.now, in.asked);
                for (int i = 0; i < 3; ++i) {
                    CHECK(machine.step(in.now, in.asked).owner == Owner::nobody);
                    CHECK_FALSE(machine.wants_armed());
                }
            });
        }
    }
}

// Asking again and again does not hold a phase open: neither arming nor a ramp.
TEST(SupervisorEnumeration, arming_and_ramps_end_whatever_is_asked_for) {
    for (const Node& node : states(31)) {
        if (node.state.phase == Phase::steady) continue;
        for (std::size_t first = 0; first < kModeRequests; ++first) {
            for (std::size_t second = 0; second < kModeRequests; ++second) {
                Supervisor machine = node.machine;
                for (int i = 0; i <= kLimit + 1; ++i) {
                    Input in = ordinary(node.state.braking(), true);
                    happen(kConditions.size() + (i % 2 == 0 ? first : second), in);
                    // Idle gives arming up, and who drives on anew does not brake any more.
                    const bool other =
                        node.state.braking() ? driving(*in.asked.mode) : *in.asked.mode == Mode::idle;
                    if (other) in.asked.mode.reset();
                    machine.step(in.now, in.asked);
                }
                CHECK(machine.phase() == Phase::steady);
            }
        }
    }
}

// With the causes gone and the robot at rest: idle by one ClearFault, and from there every mode.
TEST(SupervisorEnumeration, nothing_is_without_a_way_out) {
    for (const unsigned choices : {0U, 31U, kKey}) {
        for (const Node& node : states(choices)) {
            for (std::size_t m = 0; m < kModeCount; ++m) {
                const Mode wanted = static_cast<Mode>(m);
                if (!driving(wanted)) continue;
                Supervisor machine = node.machine;
                const auto cycle = [&machine](const Requests& asked) {
                    return machine.step(ordinary(machine.wants_armed(), false).now, asked);
                };
                cycle({false, Mode::idle});
                cycle({});
                cycle({true, {}});
                CHECK(machine.mode() == Mode::idle);
                CHECK_FALSE(machine.wants_armed());
                cycle({false, wanted, true});
                cycle({});
                CHECK(machine.mode() == wanted);
                CHECK(machine.may_drive());
            }
        }
    }
}
