// Authenticated arming through the whole chain: hosts that hold the key, and others that do not, on the bus
// of a firmware that has one. Judged by the drives and the wheels.
#include <cmath>
#include <vector>

#include "tests/chain/scene.hpp"
#include "tests/support/key_holder.hpp"

namespace {

using namespace chain;
using protocol::ArmingAnswer;
using protocol::ArmingChallenge;
using protocol::Blocker;
using support::KeyHolder;

constexpr std::array kDriving{Mode::torque, Mode::ident,      Mode::velocity,
                              Mode::pose,   Mode::trajectory, Mode::adaptive};
constexpr auto kRejected = std::size_t(protocol::CounterCause::rejected_answer);

// A robot whose firmware has a key, and the host's end of its bus.
class Locked {
  public:
    explicit Locked(bool separate = false) : sim(identified(), real().parameters, options(separate, holder)) {
        KeyHolder::listen(sim.host_bus());
        sim.run_for(0.5);
    }

    static SimulationOptions options(bool separate, KeyHolder& holder) {
        SimulationOptions o = Scene::options({separate, 0, 1}, 31);
        o.arming_key = holder.key();
        return o;
    }

    // Asks for a mode and waits for the challenge.
    ArmingChallenge challenge(Mode mode) {
        KeyHolder::heard(sim.host_bus());  // what came before may be old
        sim.host().mode(mode);
        std::optional<ArmingChallenge> heard;
        sim.run_until(
            [&] {
                watch();
                heard = KeyHolder::heard(sim.host_bus());
                return heard.has_value();
            },
            6);
        CHECK(heard.has_value());
        return heard.value_or(ArmingChallenge{});
    }
    void send(const ArmingAnswer& answer) { sim.host_bus().send(holder.frame(answer)); }
    void run(double duration_s) {
        sim.run_for(duration_s, [&] { watch(); });
    }
    // Whether the robot is in this mode within a second.
    bool enters(Mode mode) {
        sim.run_until([&] { return supervisor().mode() == mode && supervisor().may_drive(); }, 1);
        return supervisor().mode() == mode;
    }
    void arm(Mode mode) {
        proven = true;
        send(holder.answer(challenge(mode), mode));
        CHECK(enters(mode));
    }
    void rest() {
        sim.host().mode(Mode::idle);
        CHECK(sim.run_until([&] { return supervisor().mode() == Mode::idle && !supervisor().wants_armed(); },
                            5));
        run(0.3);
        proven = false;
    }

    // Without a proof no drive is ever armed.
    void watch() {
        if (proven) return;
        CHECK_FALSE(supervisor().wants_armed());
        CHECK_FALSE(sim.world().left().armed());
        CHECK_FALSE(sim.world().right().armed());
    }

    const supervisor::Supervisor& supervisor() const { return sim.cycle().supervisor(); }
    std::uint32_t rejected() const { return sim.cycle().report().counters[kRejected]; }

    KeyHolder holder;
    bool proven = false;
    Simulation sim;
};

}  // namespace

TEST_GROUP(ChainArming){};

TEST(ChainArming, no_mode_that_arms_is_entered_without_the_key_and_each_is_with_it) {
    for (const bool separate : {false, true}) {
        Locked robot(separate);
        for (const Mode mode : kDriving) {
            for (int i = 0; i < 20; ++i) {
                robot.sim.host().mode(mode);
                robot.run(0.05);
                CHECK(robot.supervisor().blocker() == Blocker::not_authenticated);
            }
            robot.run(1);
            robot.arm(mode);
            CHECK(robot.supervisor().blocker() == Blocker::none);
            robot.rest();
        }
        LONGS_EQUAL(0, robot.rejected());
    }
}

TEST(ChainArming, what_else_is_in_the_way_is_named_before_the_key_and_asks_no_question) {
    Locked robot;
    robot.sim.emergency_stop().set(hal::LineLevel::active);
    robot.sim.host().mode(Mode::velocity);
    robot.run(0.1);
    CHECK(robot.supervisor().blocker() == Blocker::stop_line_active);
    CHECK_FALSE(KeyHolder::heard(robot.sim.host_bus()).has_value());
}

// Stop, idle and clearing need no key: they take torque away, or leave it away.
TEST(ChainArming, every_stop_works_without_the_key_and_clearing_does_not_arm) {
    Locked robot;
    robot.sim.host().velocity({0.5, 0});
    robot.arm(Mode::velocity);
    robot.sim.run_for(0.5);
    robot.sim.host().emergency_stop();
    robot.sim.run_for(0.003);
    CHECK(robot.supervisor().fault() == Fault::emergency_stop_message);
    DOUBLES_EQUAL(0, robot.sim.world().left().torque_target_Nm(), 0);
    CHECK(robot.sim.run_until([&] { return !robot.sim.world().left().armed(); }, 0.1));
    robot.sim.run_for(3);
    robot.proven = false;
    robot.sim.host().clear_fault();
    robot.run(0.2);
    CHECK(robot.supervisor().mode() == Mode::idle);
    robot.sim.host().mode(Mode::velocity);
    robot.run(1);
    CHECK(robot.supervisor().blocker() == Blocker::not_authenticated);
}

// This is what stays open, and is said in docs/driving.md.
TEST(ChainArming, an_armed_robot_obeys_whoever_speaks) {
    Locked robot;
    robot.arm(Mode::velocity);
    robot.sim.host().velocity({0.3, 0});
    robot.sim.run_for(0.5);
    CHECK(std::abs(robot.sim.world().twist().v_m_per_s - 0.3) < 0.05);
    robot.sim.host().mode(Mode::torque);
    CHECK(robot.enters(Mode::torque));
    CHECK_FALSE(KeyHolder::heard(robot.sim.host_bus()).has_value());
}

// Everything that was on the bus while the holder armed, played again: at once, later, and where a challenge
// waits.
TEST(ChainArming, a_recording_arms_nothing) {
    Locked robot;
    std::vector<ArmingAnswer> recorded;
    for (const Mode mode : {Mode::velocity, Mode::torque}) {
        recorded.push_back(robot.holder.answer(robot.challenge(mode), mode));
        robot.proven = true;
        robot.send(recorded.back());
        CHECK(robot.enters(mode));
        robot.rest();
    }
    std::uint32_t before = robot.rejected();
    for (const ArmingAnswer& old : recorded) {
        robot.send(old);  // nobody has asked
        robot.run(0.1);
        LONGS_EQUAL(++before, robot.rejected());
        robot.challenge(old.mode);
        robot.send(old);  // where a new challenge waits
        robot.run(0.1);
        LONGS_EQUAL(++before, robot.rejected());
        CHECK(robot.supervisor().blocker() == Blocker::not_authenticated);
    }
    robot.arm(Mode::velocity);
}

TEST(ChainArming, a_wrong_key_another_robot_another_mode_or_an_old_challenge_arm_nothing) {
    Locked robot;
    KeyHolder wrong_key(9);
    KeyHolder other_robot(7, "robot 2");
    robot.send(wrong_key.answer(robot.challenge(Mode::velocity), Mode::velocity));
    robot.run(0.1);
    robot.send(other_robot.answer(robot.challenge(Mode::velocity), Mode::velocity));
    robot.run(0.1);
    ArmingAnswer bent = robot.holder.answer(robot.challenge(Mode::velocity), Mode::velocity);
    bent.mode = Mode::torque;  // somebody turned it into another mode
    robot.send(bent);
    robot.run(0.1);
    LONGS_EQUAL(3, robot.rejected());
    const ArmingChallenge challenge = robot.challenge(Mode::velocity);
    robot.run(1.01);
    robot.send(robot.holder.answer(challenge, Mode::velocity));
    robot.run(0.5);
    LONGS_EQUAL(4, robot.rejected());
    robot.arm(Mode::velocity);
}

// One bit turned anywhere in the frame on its way.
TEST(ChainArming, no_bit_of_an_answer_may_be_turned) {
    Locked robot;
    for (unsigned bit = 0; bit < 64; ++bit) {
        hal::CanFrame frame =
            robot.holder.frame(robot.holder.answer(robot.challenge(Mode::torque), Mode::torque));
        frame.data[bit / 8] = static_cast<std::uint8_t>(frame.data[bit / 8] ^ 1U << bit % 8);
        robot.sim.host_bus().send(frame);  // the seal is broken: noise uses no challenge up
        robot.run(0.02);
    }
    LONGS_EQUAL(0, robot.rejected());
    for (unsigned bit = 12; bit < 64; bit += 3) {
        hal::CanFrame frame =
            robot.holder.frame(robot.holder.answer(robot.challenge(Mode::torque), Mode::torque));
        frame.data[bit / 8] = static_cast<std::uint8_t>(frame.data[bit / 8] ^ 1U << bit % 8);
        protocol::seal({frame.data.data(), frame.length}, static_cast<std::uint8_t>(frame.data[1] & 15U));
        robot.sim.host_bus().send(frame);
        robot.run(0.02);
    }
    CHECK(robot.rejected() > 15);
    robot.arm(Mode::torque);
}

TEST(ChainArming, of_two_hosts_one_arms_and_the_other_costs_no_time) {
    Locked robot;
    const ArmingChallenge first = robot.challenge(Mode::velocity);
    robot.run(0.1);
    const ArmingChallenge second = robot.challenge(Mode::pose);
    CHECK(first.nonce_low == second.nonce_low && first.nonce_high == second.nonce_high);
    robot.proven = true;
    robot.send(robot.holder.answer(first, Mode::velocity));
    robot.sim.run_for(0.002);
    robot.send(robot.holder.answer(second, Mode::pose));
    CHECK(robot.enters(Mode::velocity));
    LONGS_EQUAL(1, robot.rejected());
    robot.rest();
    const double asked_s = robot.sim.time_s();
    robot.challenge(Mode::velocity);
    CHECK(robot.sim.time_s() - asked_s < 0.01);
}

// In one cycle: idle is stronger than a proof, a proof than what is not proven.
TEST(ChainArming, requests_of_one_cycle_do_not_mix) {
    Locked robot;
    ArmingChallenge challenge = robot.challenge(Mode::velocity);
    robot.send(robot.holder.answer(challenge, Mode::velocity));
    robot.sim.host().mode(Mode::idle);
    robot.run(0.5);
    CHECK(robot.supervisor().mode() == Mode::idle);
    challenge = robot.challenge(Mode::velocity);
    robot.proven = true;
    robot.sim.host().mode(Mode::torque);
    robot.send(robot.holder.answer(challenge, Mode::velocity));
    robot.sim.host().mode(Mode::pose);
    CHECK(robot.enters(Mode::velocity));
}

// While one asks in each millisecond, another one guesses: telemetry goes on, and the holder arms when the
// guesses end.
TEST(ChainArming, a_flood_of_questions_and_guesses_keeps_nobody_out_afterwards) {
    Locked robot;
    int challenges = 0;
    int status = 0;
    class Count final : public sim::BusTap {
      public:
        Count(int& challenges, int& status) : challenges_(challenges), status_(status) {}
        void on_frame(const sim::WireEvent& event) override {
            challenges_ += event.frame->id == ArmingChallenge::id ? 1 : 0;
            status_ += event.frame->id == protocol::Status::id ? 1 : 0;
        }

      private:
        int& challenges_;
        int& status_;
    } count(challenges, status);
    robot.sim.bus().add_tap(count);
    sim::Random random(3);
    const auto flood = [&](double duration_s, bool guesses) {
        robot.sim.run_for(duration_s, [&] {
            robot.watch();
            robot.sim.host().mode(Mode::velocity);
            if (!guesses) return;
            ArmingAnswer guess;
            guess.mode = Mode::velocity;
            guess.code_low = static_cast<std::uint32_t>(random.bits());
            guess.code_high = static_cast<std::uint16_t>(random.bits());
            robot.send(guess);
        });
    };
    flood(4, false);
    CHECK_TEXT(status > 150, std::to_string(status).c_str());
    CHECK_TEXT(challenges > 3 && challenges < 130, std::to_string(challenges).c_str());
    challenges = 0;
    flood(20, true);
    // 0.1 + 0.2 + ... + 1.6 s, then each 3.2 s.
    CHECK_TEXT(challenges >= 8 && challenges <= 12, std::to_string(challenges).c_str());
    const double over_s = robot.sim.time_s();
    robot.challenge(Mode::velocity);
    CHECK(robot.sim.time_s() - over_s < 3.21);
    robot.run(1);
    flood(1, false);  // asking alone spoils nothing
    const ArmingChallenge challenge = robot.challenge(Mode::velocity);
    flood(0.4, false);
    robot.proven = true;
    robot.send(robot.holder.answer(challenge, Mode::velocity));
    CHECK(robot.enters(Mode::velocity));
}

// The key is no parameter: whatever is read, written and committed, it stays, and nothing tells it.
TEST(ChainArming, no_parameter_reads_the_key_or_switches_it_off) {
    Locked robot;
    using protocol::ParameterOperation;
    for (const model::ParameterInfo& info : model::parameter_table()) {
        CHECK(info.key.find("key") == std::string_view::npos && !info.key.starts_with("arming"));
    }
    sim::Random random(5);
    for (const float value : {0.0F, 1.0F}) {
        for (const model::ParameterInfo& info : model::parameter_table()) {
            if (info.when == model::ChangeWhen::start || info.key.starts_with("bus")) continue;
            robot.sim.host().parameter(ParameterOperation::write, info.index, value);
            robot.run(0.002);
            robot.sim.host().parameter(ParameterOperation::commit, 0);
            robot.run(0.002);
            robot.sim.host().parameter(ParameterOperation::discard, 0);
            robot.run(0.002);
        }
        for (int i = 0; i < 300; ++i) {
            const auto index = static_cast<std::uint16_t>(random.bits());
            robot.sim.host().parameter(ParameterOperation::write, index, value);
            robot.run(0.002);
        }
        robot.sim.host().parameter(ParameterOperation::commit, 0);
        robot.run(0.1);
        for (const Mode mode : kDriving) {
            robot.sim.host().mode(mode);
            robot.run(0.2);
        }
    }
}
