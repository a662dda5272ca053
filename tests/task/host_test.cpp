// What the host says and asks: commands taken apart, and the indexed parameters.
#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "firmware/model/robot_parameters.hpp"
#include "firmware/protocol/command_guard.hpp"
#include "firmware/task/host_link.hpp"
#include "firmware/task/parameter_service.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::task;
using Cause = HostLink::Cause;

namespace {

constexpr std::int64_t kMs = 1'000'000;

// A host whose counters go on as they shall, and the link that hears it.
struct Host {
    template <typename Message>
    static hal::CanFrame sealed(const Message& message, std::uint8_t alive) {
        hal::CanFrame frame;
        frame.id = Message::id;
        frame.length = Message::length;
        CHECK(protocol::encode_sealed(message, alive, frame.data) == protocol::CodecStatus::ok);
        return frame;
    }

    template <typename Message>
    bool say(const Message& message, std::optional<std::uint8_t> alive = {}) {
        const std::uint8_t next = alive ? *alive : static_cast<std::uint8_t>(sent++ % 15);
        now += kMs;
        return link.accept({sealed(message, next), now});
    }

    HostLink link;
    std::int64_t now = 100 * kMs;
    unsigned sent = 0;
};

// One of every command.
template <typename Visit>
void for_each_command(Visit visit) {
    visit(protocol::ModeCommand{});
    visit(protocol::TorqueCommand{});
    visit(protocol::VelocityCommand{});
    visit(protocol::PoseGoal{});
    visit(protocol::StreamedPose{});
    visit(protocol::StreamedVelocity{});
    visit(protocol::ExternalPose{});
    visit(protocol::TrajectoryCommand{});
    visit(protocol::IdentSettings{});
    visit(protocol::ParameterRequest{});
    visit(protocol::ClearFault{});
    visit(protocol::ArmingAnswer{});
    visit(protocol::HostAlive{});
}

}  // namespace

TEST_GROUP(HostCommands){};

TEST(HostCommands, each_set_point_is_kept_with_its_time_until_forgotten) {
    Host host;
    protocol::TorqueCommand torque;
    torque.left_torque_Nm = 1;
    torque.right_torque_Nm = -2;
    CHECK(host.say(torque));
    CHECK(host.link.torque_Nm.received);
    CHECK_EQUAL(host.now, host.link.torque_Nm.time_ns);
    DOUBLES_EQUAL(1, host.link.torque_Nm.value.left, 1e-3);
    DOUBLES_EQUAL(-2, host.link.torque_Nm.value.right, 1e-3);
    protocol::VelocityCommand velocity;
    velocity.forward_speed_m_per_s = 0.5;
    velocity.yaw_rate_rad_per_s = -0.25;
    CHECK(host.say(velocity));
    CHECK(host.link.velocity.received);
    DOUBLES_EQUAL(0.5, host.link.velocity.value.v_m_per_s, 1e-3);
    DOUBLES_EQUAL(-0.25, host.link.velocity.value.omega_rad_per_s, 1e-3);
    protocol::PoseGoal goal;
    goal.x_m = 1;
    goal.heading_rad = 0.5;
    CHECK(host.say(goal));
    CHECK(host.link.goal.received);
    DOUBLES_EQUAL(1, host.link.goal.value.pose.x_m, 1e-3);
    protocol::StreamedPose pose;
    pose.y_m = 3;
    CHECK(host.say(pose, std::uint8_t{4}));
    CHECK_FALSE(host.link.streamed.received);
    CHECK(host.say(protocol::StreamedVelocity{}, std::uint8_t{4}));
    CHECK(host.link.streamed.received);
    DOUBLES_EQUAL(3, host.link.streamed.value.pose.y_m, 1e-3);
    host.link.forget_setpoints();
    CHECK_FALSE(host.link.torque_Nm.received || host.link.velocity.received || host.link.goal.received ||
                host.link.streamed.received);
    host.link.begin_cycle();
    protocol::ExternalPose external;
    external.x_m = -2;
    CHECK(host.say(external));
    CHECK(host.link.events().external_pose);
    CHECK(host.link.external_pose.received);
    DOUBLES_EQUAL(-2, host.link.external_pose.value.x_m, 1e-3);
    for (std::size_t cause = 0; cause < protocol::counter_cause_values.size(); ++cause) {
        CHECK_EQUAL(0U, host.link.counter(static_cast<Cause>(cause)));
    }
}

TEST(HostCommands, each_request_is_an_event_of_one_cycle) {
    Host host;
    protocol::ModeCommand mode;
    mode.mode = protocol::Mode::velocity;
    CHECK(host.say(mode) && host.say(protocol::TrajectoryCommand{}) && host.say(protocol::IdentSettings{}) &&
          host.say(protocol::ClearFault{}));
    CHECK(host.link.events().mode == protocol::Mode::velocity);
    CHECK(host.link.events().trajectory.has_value());
    CHECK(host.link.events().ident.has_value());
    CHECK(host.link.events().clear_fault);
    CHECK_FALSE(host.link.events().stop || host.link.events().external_pose);
    // One answer is tried in a cycle.
    protocol::ArmingAnswer answer;
    CHECK_FALSE(host.link.events().answer.has_value());
    for (const std::uint32_t first : {1U, 2U}) {
        answer.code_low = first;
        CHECK(host.say(answer));
        CHECK_EQUAL(1U, host.link.events().answer->code_low);
        CHECK_EQUAL(first - 1U, host.link.counter(Cause::rejected_answer));
    }
    for (std::uint16_t i = 0; i < 8; ++i) {
        protocol::ParameterRequest request;
        request.index = i;
        CHECK(host.say(request));
    }
    CHECK_EQUAL(0U, host.link.counter(Cause::receive_overflow));
    CHECK(host.say(protocol::ParameterRequest{}));  // more than a cycle answers
    CHECK_EQUAL(1U, host.link.counter(Cause::receive_overflow));
    CHECK_EQUAL(8U, host.link.events().parameter_count);
    for (std::uint16_t i = 0; i < 8; ++i) CHECK_EQUAL(i, host.link.events().parameters[i].index);
    host.link.begin_cycle();
    CHECK_FALSE(host.link.events().mode || host.link.events().trajectory || host.link.events().ident ||
                host.link.events().clear_fault || host.link.events().parameter_count > 0);
}

TEST(HostCommands, a_frame_that_is_wrong_in_any_way_changes_nothing_and_is_counted) {
    for_each_command([]<typename Message>(const Message& message) {
        Host host;
        const auto nothing = [&] {
            const HostEvents& e = host.link.events();
            CHECK_FALSE(host.link.torque_Nm.received || host.link.velocity.received ||
                        host.link.goal.received || host.link.streamed.received ||
                        host.link.external_pose.received);
            CHECK_FALSE(e.mode || e.trajectory || e.ident || e.clear_fault || e.answer || e.stop ||
                        e.external_pose || e.parameter_count > 0);
            CHECK_EQUAL(0, host.link.heard_ns());
        };
        hal::CanFrame frame = Host::sealed(message, 1);
        // Of another kind: not the link's at all, and nothing to count.
        for (bool hal::CanFrame::*kind :
             {&hal::CanFrame::extended, &hal::CanFrame::remote, &hal::CanFrame::error}) {
            hal::CanFrame other = frame;
            other.*kind = true;
            CHECK_FALSE(host.link.accept({other, host.now}));
            CHECK_FALSE(host.link.accept_anywhere(other));
            nothing();
        }
        frame.data[0] ^= 1;
        CHECK(host.link.accept({frame, host.now}));
        nothing();
        CHECK_EQUAL(1U, host.link.counter(Cause::rejected_crc));
        frame = Host::sealed(message, 1);
        ++frame.length;
        CHECK(host.link.accept({frame, host.now}));
        nothing();
        CHECK_EQUAL(1U, host.link.counter(Cause::rejected_length));
    });
    // What the codec refuses behind a right seal.
    Host host;
    hal::CanFrame frame = Host::sealed(protocol::ModeCommand{}, 1);
    frame.data[2] = 200;
    protocol::seal({frame.data.data(), frame.length}, 1);
    CHECK(host.link.accept({frame, host.now}));
    CHECK_EQUAL(1U, host.link.counter(Cause::rejected_unknown_mode));
    CHECK_FALSE(host.link.events().mode);
    CHECK_EQUAL(0, host.link.heard_ns());
}

TEST(HostCommands, every_accepted_frame_is_a_sign_of_the_host_but_a_pose) {
    for_each_command([]<typename Message>(const Message& message) {
        Host host;
        CHECK(host.say(message));
        CHECK_EQUAL(Message::id == protocol::ExternalPose::id ? 0 : host.now, host.link.heard_ns());
    });
}

TEST(HostCommands, a_streamed_pose_needs_the_velocity_of_its_own_counter) {
    Host host;
    host.say(protocol::StreamedPose{}, std::uint8_t{1});
    host.say(protocol::StreamedPose{}, std::uint8_t{2});  // the first is left alone
    CHECK_EQUAL(1U, host.link.counter(Cause::rejected_unpaired));
    host.say(protocol::StreamedVelocity{}, std::uint8_t{1});
    CHECK_EQUAL(2U, host.link.counter(Cause::rejected_unpaired));
    CHECK_FALSE(host.link.streamed.received);
    host.say(protocol::StreamedVelocity{}, std::uint8_t{2});  // too late: the pose was given up
    CHECK_EQUAL(3U, host.link.counter(Cause::rejected_unpaired));
    CHECK_FALSE(host.link.streamed.received);
    host.say(protocol::StreamedPose{}, std::uint8_t{3});
    host.say(protocol::StreamedVelocity{}, std::uint8_t{3});
    CHECK(host.link.streamed.received);
    host.say(protocol::StreamedPose{}, std::uint8_t{4});  // a new pair, not a pose without its velocity
    CHECK_EQUAL(3U, host.link.counter(Cause::rejected_unpaired));
}

TEST(HostCommands, a_stop_is_heard_anywhere_and_so_is_another_firmware) {
    Host host;
    hal::CanFrame stop;
    stop.id = protocol::EmergencyStop::id;
    stop.length = 3;
    CHECK(host.link.accept_anywhere(stop));
    CHECK(host.link.events().stop);
    host.link.begin_cycle();
    CHECK(host.link.accept({stop, host.now}));
    CHECK(host.link.events().stop);
    for (bool hal::CanFrame::*kind :
         {&hal::CanFrame::extended, &hal::CanFrame::remote, &hal::CanFrame::error}) {
        host.link.begin_cycle();
        hal::CanFrame other = stop;
        other.*kind = true;
        CHECK_FALSE(host.link.accept_anywhere(other));
        CHECK_FALSE(host.link.accept({other, host.now}));
        CHECK_FALSE(host.link.events().stop);
    }
    hal::CanFrame status;
    status.id = protocol::Status::id;
    CHECK(host.link.accept_anywhere(status));
    CHECK_EQUAL(1U, host.link.counter(Cause::foreign_control));
    CHECK_FALSE(host.link.accept_anywhere(Host::sealed(protocol::ModeCommand{}, 1)));
    hal::CanFrame nobodys;
    nobodys.id = 0x60F;
    CHECK_FALSE(host.link.accept({nobodys, host.now}));
}

TEST_GROUP(ParameterRequests){};

namespace {

constexpr std::uint16_t kTrack = 0x0003, kTorqueLimit = 0x0010, kSpeedLimit = 0x0011, kUnknown = 0x7FFF;

std::uint16_t index_of(std::string_view key) { return model::find_parameter(key)->index; }

struct Parameters {
    using Result = protocol::ParameterResult;
    using Operation = protocol::ParameterOperation;

    Result ask(Operation operation, std::uint16_t index = 0, double value = 0, bool idle = true) {
        protocol::ParameterRequest request;
        request.operation = operation;
        request.index = index;
        request.value = static_cast<float>(value);
        reply = service.answer(request, idle);
        CHECK(reply.operation == operation);
        CHECK_EQUAL(index, reply.index);
        return reply.result;
    }
    Result write(std::uint16_t index, double value) { return ask(Operation::write, index, value); }
    Result commit(bool idle = true) { return ask(Operation::commit, 0, 0, idle); }
    double read(std::uint16_t index) {
        CHECK(ask(Operation::read, index) == Result::ok);
        return static_cast<double>(reply.value);
    }

    model::RobotParameters live = model::default_parameters();
    SaveMailbox mailbox;
    ParameterService service{live, mailbox};
    protocol::ParameterReply reply;
};

using Result = Parameters::Result;
using Operation = Parameters::Operation;

}  // namespace

TEST(ParameterRequests, writes_take_effect_together_on_commit_and_once) {
    Parameters p;
    const double before = p.read(kTorqueLimit);
    CHECK(p.write(kTorqueLimit, 1.5) == Result::ok);
    DOUBLES_EQUAL(1.5, static_cast<double>(p.reply.value), 0);
    CHECK(p.write(kSpeedLimit, 0.75) == Result::ok);
    DOUBLES_EQUAL(before, p.read(kTorqueLimit), 0);
    CHECK_FALSE(p.service.changed());
    CHECK(p.commit() == Result::ok);
    DOUBLES_EQUAL(1.5, p.read(kTorqueLimit), 0);
    DOUBLES_EQUAL(0.75, p.live.limits.speed_m_per_s, 0);
    CHECK(p.service.changed());
    CHECK_FALSE(p.service.changed());
    CHECK(p.commit() == Result::nothing_staged);
    // What the firmware changes meanwhile is not turned back by a commit of something else.
    CHECK(p.write(kSpeedLimit, 0.5) == Result::ok);
    p.service.record(kTorqueLimit, 2.5);
    CHECK(p.commit() == Result::ok);
    DOUBLES_EQUAL(2.5, p.read(kTorqueLimit), 0);
    // Later writes are judged beside the live values, not beside those of an earlier time.
    CHECK(p.write(kTorqueLimit, 3) == Result::ok);
    CHECK(p.ask(Operation::discard) == Result::ok);
    CHECK(p.commit() == Result::nothing_staged);
    DOUBLES_EQUAL(2.5, p.read(kTorqueLimit), 0);
    // What was discarded does not come back behind what is staged then.
    CHECK(p.write(kTorqueLimit, 3) == Result::ok);
    CHECK(p.write(kSpeedLimit, 0.25) == Result::ok);
    CHECK(p.ask(Operation::discard) == Result::ok);
    CHECK(p.write(kTorqueLimit, 3.5) == Result::ok);
    CHECK(p.commit() == Result::ok);
    DOUBLES_EQUAL(3.5, p.read(kTorqueLimit), 0);
    DOUBLES_EQUAL(0.5, p.live.limits.speed_m_per_s, 0);
}

TEST(ParameterRequests, what_cannot_be_written_is_refused_by_its_reason) {
    Parameters p;
    CHECK(p.ask(Operation::read, kUnknown) == Result::unknown_index);
    DOUBLES_EQUAL(0, static_cast<double>(p.reply.value), 0);
    CHECK(p.write(kUnknown, 1) == Result::unknown_index);
    CHECK(p.write(kTrack, 0.4) == Result::read_only);
    CHECK(p.write(kTorqueLimit, -1) == Result::out_of_range);
    CHECK(p.write(kTorqueLimit, std::numeric_limits<double>::quiet_NaN()) == Result::not_finite);
    CHECK(p.commit() == Result::nothing_staged);
    for (int i = 0; i < 64; ++i) CHECK(p.write(kTorqueLimit, 1 + i) == Result::ok);
    CHECK(p.write(kTorqueLimit, 1) == Result::not_now);  // no more room
    CHECK(p.commit() == Result::ok);
    DOUBLES_EQUAL(64, p.read(kTorqueLimit), 0);
}

TEST(ParameterRequests, what_needs_idle_waits_for_it) {
    Parameters p;
    CHECK(p.write(kTorqueLimit, 1) == Result::ok);
    CHECK(p.commit(false) == Result::not_now);
    CHECK_FALSE(p.service.changed());
    CHECK(p.commit(true) == Result::ok);
    DOUBLES_EQUAL(1, p.live.limits.torque_Nm, 0);
}

TEST(ParameterRequests, a_commit_that_contradicts_the_rest_changes_nothing_and_stays_staged) {
    Parameters p;
    const double limit = p.live.limits.speed_m_per_s;
    CHECK(p.write(kSpeedLimit, p.live.safety.over_speed_m_per_s + 1) == Result::ok);
    CHECK(p.commit() == Result::out_of_range);
    DOUBLES_EQUAL(limit, p.live.limits.speed_m_per_s, 0);
    CHECK_FALSE(p.service.changed());
    CHECK(p.write(kTorqueLimit, 1) == Result::ok);  // does not mend it
    CHECK(p.commit() == Result::out_of_range);
    CHECK(p.write(kSpeedLimit, 1.5) == Result::ok);
    CHECK(p.commit() == Result::ok);
    DOUBLES_EQUAL(1, p.live.limits.torque_Nm, 0);
    DOUBLES_EQUAL(1.5, p.live.limits.speed_m_per_s, 0);
}

TEST(ParameterRequests, a_save_hands_over_what_has_changed_each_once) {
    Parameters p;
    const auto saved = [&] {
        std::vector<std::pair<std::uint16_t, double>> items;
        const ChangedParameters* snapshot = p.mailbox.take();
        CHECK(snapshot != nullptr);
        for (std::size_t i = 0; i < snapshot->count; ++i) {
            items.emplace_back(snapshot->items[i].index, snapshot->items[i].value);
        }
        return items;
    };
    CHECK_FALSE(p.service.saved().has_value());
    p.write(kTorqueLimit, 1.5);
    p.write(kSpeedLimit, 0.75);
    p.commit();
    p.write(kTorqueLimit, 2.5);
    p.commit();
    p.write(kSpeedLimit, 0.25);  // not committed
    p.service.record(kUnknown, 1);
    p.service.record(index_of("dynamics.k7_per_kg_m"), 0.125);
    CHECK(p.ask(Operation::save) == Result::save_started);
    DOUBLES_EQUAL(3, static_cast<double>(p.reply.value), 0);
    const auto items = saved();
    CHECK_EQUAL(3U, items.size());
    CHECK(items[0] == std::pair(kTorqueLimit, 2.5));
    CHECK(items[1] == std::pair(kSpeedLimit, 0.75));
    CHECK(items[2] == std::pair(index_of("dynamics.k7_per_kg_m"), 0.125));
    CHECK(p.ask(Operation::save) == Result::not_now);  // one at a time
    for (const bool well : {true, false}) {
        p.mailbox.finished(well);
        const auto reply = p.service.saved();
        CHECK(reply.has_value());
        CHECK(reply->operation == Operation::save);
        CHECK(reply->result == (well ? Result::ok : Result::save_failed));
        DOUBLES_EQUAL(3, static_cast<double>(reply->value), 0);
        CHECK_FALSE(p.service.saved().has_value());
        CHECK(p.ask(Operation::save) == Result::save_started);
    }
}

TEST(ParameterRequests, every_parameter_that_may_change_can_be_saved) {
    Parameters p;
    std::size_t count = 0;
    for (const model::ParameterInfo& info : model::parameter_table()) {
        p.service.record(info.index, info.get(p.live));
        ++count;
    }
    for (std::size_t effect = 0; effect < model::kEffectCount; ++effect) {
        for (std::size_t i = 0; i < model::kEffects[effect].parameters.size(); ++i) {
            const std::uint16_t index = model::effect_index(effect, i);
            double value = 0;
            model::read_parameter(p.live, index, value);
            p.service.record(index, value);
            ++count;
        }
        p.service.record(model::effect_index(effect, model::kEffectActiveSlot), 0);
        ++count;
    }
    p.service.save();
    CHECK_EQUAL(count, p.mailbox.take()->count);
    CHECK(count <= kMaxChanged);
}

TEST(ParameterRequests, every_effects_parameter_is_read_as_written_and_nothing_out_of_its_range) {
    using model::ParameterStatus;
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    model::RobotParameters p = model::default_parameters();
    const auto read = [&p](std::uint16_t index) {
        double value = kNaN;
        CHECK(model::read_parameter(p, index, value) == ParameterStatus::ok);
        return value;
    };
    for (std::size_t effect = 0; effect < model::kEffectCount; ++effect) {
        const auto& parameters = model::kEffects[effect].parameters;
        for (std::size_t i = 0; i < parameters.size(); ++i) {
            const std::uint16_t index = model::effect_index(effect, i);
            const double middle = (parameters[i].minimum + parameters[i].maximum) / 2;
            CHECK(model::write_parameter(p, index, middle) == ParameterStatus::ok);
            DOUBLES_EQUAL(middle, read(index), 0);
            CHECK(model::write_parameter(p, index, parameters[i].maximum * 1.01 + 0.01) ==
                  ParameterStatus::out_of_range);
            CHECK(model::write_parameter(
                      p, index, parameters[i].minimum * 1.01 - 0.01 * (parameters[i].minimum >= 0)) ==
                  ParameterStatus::out_of_range);
            CHECK(model::write_parameter(p, index, kNaN) == ParameterStatus::not_finite);
            DOUBLES_EQUAL(middle, read(index), 0);
            CHECK(model::changeable(index) == model::ChangeWhen::idle);
        }
        const std::uint16_t active = model::effect_index(effect, model::kEffectActiveSlot);
        DOUBLES_EQUAL(0, read(active), 0);
        CHECK(model::write_parameter(p, active, 0.5) == ParameterStatus::out_of_range);
        CHECK(model::write_parameter(p, active, 1) == ParameterStatus::ok);
        DOUBLES_EQUAL(1, read(active), 0);
        const std::uint16_t nobodys = model::effect_index(effect, model::kEffectActiveSlot - 1);
        double value = 0;
        CHECK(model::read_parameter(p, nobodys, value) == ParameterStatus::unknown_index);
        CHECK(model::write_parameter(p, nobodys, 1) == ParameterStatus::unknown_index);
        CHECK(model::changeable(nobodys) == model::ChangeWhen::start);
    }
    CHECK(model::write_parameter(p, model::find_parameter("drive.left.node")->index, 3.5) ==
          ParameterStatus::out_of_range);
}
