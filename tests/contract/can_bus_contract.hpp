// What every hal::CanBus does, as functions over a rig: three endpoints of one bus, and what the outside
// world does to it. Each function takes a fresh rig.
//
// A rig provides
//     hal::CanBus& bus(int index);        index 0..2
//     std::int64_t now_ns();              the time base of the timestamps
//     void settle();                      until everything sent has arrived wherever it goes
//     bool carries_fd();
//     std::size_t flood_frames();         more frames than a receive queue holds
//     bool limit_transmit_queue();        makes it finite; false when this bus has no such thing
//     void set_down(bool down);           takes endpoint 0's interface down or up
//     void make_error_frame(std::uint32_t error_class);   as the controllers report one
//     void set_bus_off(bool off);         endpoint 0's controller
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "hal/can_bus.hpp"
#include "tests/contract/expect.hpp"

namespace wheelwright::contract {

// --- helpers ---------------------------------------------------------------------------------------------

inline hal::CanFrame make_frame(std::uint32_t id, std::uint8_t length, std::uint8_t seed = 0) {
    hal::CanFrame frame;
    frame.id = id;
    frame.length = length;
    for (std::size_t i = 0; i < frame.data.size(); ++i) {
        frame.data[i] = static_cast<std::uint8_t>(seed + 37 * i + 11);
    }
    return frame;
}

inline bool same(const hal::CanFrame& one, const hal::CanFrame& other) {
    if (one.id != other.id || one.length != other.length || one.extended != other.extended ||
        one.remote != other.remote || one.fd != other.fd || one.bit_rate_switch != other.bit_rate_switch ||
        one.error != other.error) {
        return false;
    }
    for (std::size_t i = 0; !one.remote && i < one.length; ++i) {
        if (one.data[i] != other.data[i]) {
            return false;
        }
    }
    return true;
}

// Looks anew when the last look found nothing behind what it took.
inline hal::CanStatus receive(hal::CanBus& bus, hal::ReceivedFrame& out) {
    const hal::CanStatus status = bus.receive(out);
    return status == hal::CanStatus::would_block ? bus.receive(out) : status;
}

// The next frame that is not an error frame; a disturbed bus has those in between.
inline hal::CanStatus receive_data(hal::CanBus& bus, hal::ReceivedFrame& out) {
    hal::CanStatus status = receive(bus, out);
    while (status == hal::CanStatus::ok && out.frame.error) {
        status = receive(bus, out);
    }
    return status;
}

template <typename Rig>
bool arrives(Rig& rig, int from, int to, const hal::CanFrame& frame) {
    if (rig.bus(from).send(frame) != hal::CanStatus::ok) {
        return false;
    }
    rig.settle();
    hal::ReceivedFrame received;
    if (receive_data(rig.bus(to), received) != hal::CanStatus::ok) {
        return false;
    }
    EXPECT_THAT(same(frame, received.frame));
    return true;
}

inline std::size_t drain(hal::CanBus& bus) {
    hal::ReceivedFrame received;
    std::size_t count = 0;
    while (receive_data(bus, received) == hal::CanStatus::ok) {
        ++count;
    }
    return count;
}

// --- the contract ----------------------------------------------------------------------------------------

template <typename Rig>
void every_length_arrives_unchanged_at_all_others_once(Rig& rig) {
    for (std::uint8_t length = 0; length <= 8; ++length) {
        for (const bool extended : {false, true}) {
            hal::CanFrame frame = make_frame(extended ? 0x1234'5678U : 0x123U, length, length);
            frame.extended = extended;
            EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(frame));
            rig.settle();
            for (const int receiver : {1, 2}) {
                hal::ReceivedFrame received;
                EXPECT_EQUAL(hal::CanStatus::ok, receive_data(rig.bus(receiver), received));
                EXPECT_THAT(same(frame, received.frame));
                EXPECT_EQUAL(hal::CanStatus::would_block, receive_data(rig.bus(receiver), received));
            }
        }
    }
}

template <typename Rig>
void the_ends_of_both_identifier_ranges_arrive(Rig& rig) {
    for (const std::uint32_t id : {0x0U, 0x7FFU}) {
        EXPECT_THAT(arrives(rig, 0, 1, make_frame(id, 3)));
    }
    for (const std::uint32_t id : {0x0U, 0x7FFU, 0x800U, 0x1FFF'FFFFU}) {
        hal::CanFrame frame = make_frame(id, 3);
        frame.extended = true;
        EXPECT_THAT(arrives(rig, 0, 1, frame));
    }
}

template <typename Rig>
void own_frames_are_not_received(Rig& rig) {
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x10, 8)));
    rig.settle();
    EXPECT_EQUAL(0, drain(rig.bus(0)));
    EXPECT_EQUAL(1, drain(rig.bus(1)));
    EXPECT_EQUAL(0, rig.bus(0).statistics().frames_received);
}

// With filters or without, as far as they accept it; also when the others have to be looked at first.
template <typename Rig>
void a_frame_waits_until_it_has_left(Rig& rig) {
    const std::array filters{hal::CanFilter{0x20, 0x7F0, false}};
    for (const bool filtered : {false, true}) {
        if (filtered) EXPECT_THAT(rig.bus(0).set_filters(filters));
        EXPECT_EQUAL(false, rig.bus(0).waits(0x21));
        for (const std::uint32_t id : {0x21U, 0x22U, 0x21U}) {
            EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(id, 8)));
        }
        EXPECT_THAT(rig.bus(0).waits(0x21));
        EXPECT_THAT(rig.bus(0).waits(0x22));
        EXPECT_EQUAL(false, rig.bus(0).waits(0x23));
        EXPECT_EQUAL(false, rig.bus(1).waits(0x21));
        rig.settle();
        EXPECT_EQUAL(0, drain(rig.bus(0)));
        EXPECT_EQUAL(3, drain(rig.bus(1)));
        EXPECT_EQUAL(false, rig.bus(0).waits(0x21));
        EXPECT_EQUAL(false, rig.bus(0).waits(0x22));
    }
}

template <typename Rig>
void an_empty_bus_says_would_block(Rig& rig) {
    hal::ReceivedFrame received;
    for (const int index : {0, 1, 2}) {
        EXPECT_EQUAL(hal::CanStatus::would_block, rig.bus(index).receive(received));
    }
}

template <typename Rig>
void one_senders_frames_keep_their_order(Rig& rig) {
    for (std::uint32_t i = 0; i < 200; ++i) {
        // Falling identifiers: arbitration must not reorder one sender's queue.
        EXPECT_EQUAL(hal::CanStatus::ok,
                     rig.bus(0).send(make_frame(0x700 - i, 2, static_cast<std::uint8_t>(i))));
        if (i % 8 == 7) {
            rig.settle();
        }
    }
    rig.settle();
    hal::ReceivedFrame received;
    for (std::uint32_t i = 0; i < 200; ++i) {
        EXPECT_EQUAL(hal::CanStatus::ok, receive_data(rig.bus(1), received));
        EXPECT_THAT(same(make_frame(0x700 - i, 2, static_cast<std::uint8_t>(i)), received.frame));
    }
    EXPECT_EQUAL(hal::CanStatus::would_block, receive_data(rig.bus(1), received));
}

template <typename Rig>
void remote_frames_arrive_as_such(Rig& rig) {
    for (const bool extended : {false, true}) {
        for (const std::uint8_t length : {std::uint8_t{0}, std::uint8_t{4}, std::uint8_t{8}}) {
            hal::CanFrame frame = make_frame(0x345, length);
            frame.remote = true;
            frame.extended = extended;
            EXPECT_THAT(arrives(rig, 0, 1, frame));
        }
    }
}

template <typename Rig>
void fd_frames_arrive_on_an_fd_bus_and_are_invalid_on_a_classic_one(Rig& rig) {
    for (const int length : {0, 1, 8, 12, 16, 20, 24, 32, 48, 64}) {
        for (const bool fast : {false, true}) {
            hal::CanFrame frame = make_frame(0x456, static_cast<std::uint8_t>(length));
            frame.fd = true;
            frame.bit_rate_switch = fast;
            if (rig.carries_fd()) {
                EXPECT_THAT(arrives(rig, 0, 1, frame));
            } else {
                EXPECT_EQUAL(hal::CanStatus::invalid, rig.bus(0).send(frame));
            }
        }
    }
    // Classic frames pass on either.
    drain(rig.bus(1));
    EXPECT_THAT(arrives(rig, 0, 1, make_frame(0x457, 8)));
}

template <typename Rig>
void malformed_frames_are_invalid_and_reach_nobody(Rig& rig) {
    std::array<hal::CanFrame, 9> bad;
    bad.fill(make_frame(0x100, 8));
    bad[0].length = 9;
    bad[1].id = 0x800;
    bad[2].id = 0x2000'0000;
    bad[2].extended = true;
    bad[3].error = true;
    bad[4].bit_rate_switch = true;  // a classic frame has none
    bad[5].fd = true;
    bad[5].length = 9;  // FD has no such length
    bad[6].fd = true;
    bad[6].remote = true;  // nor remote frames
    bad[7].fd = true;
    bad[7].length = 65;
    bad[8].length = 255;
    std::uint64_t refused = 0;
    for (const hal::CanFrame& frame : bad) {
        EXPECT_EQUAL(hal::CanStatus::invalid, rig.bus(0).send(frame));
        ++refused;
        EXPECT_EQUAL(refused, rig.bus(0).statistics().send_refused);
    }
    rig.settle();
    EXPECT_EQUAL(0, drain(rig.bus(1)));
    EXPECT_EQUAL(0, rig.bus(0).statistics().frames_sent);
}

template <typename Rig>
void timestamps_lie_between_send_and_receive_and_do_not_go_back(Rig& rig) {
    std::int64_t last_ns = rig.now_ns();
    for (int i = 0; i < 20; ++i) {
        const std::int64_t sent_ns = rig.now_ns();
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(i % 2).send(make_frame(0x20, 8)));
        rig.settle();
        hal::ReceivedFrame received;
        EXPECT_EQUAL(hal::CanStatus::ok, receive_data(rig.bus(2), received));
        const std::int64_t read_ns = rig.now_ns();
        EXPECT_THAT(received.timestamp_ns >= last_ns);
        EXPECT_THAT(received.timestamp_ns >= sent_ns);
        EXPECT_THAT(received.timestamp_ns <= read_ns);
        last_ns = received.timestamp_ns;
    }
}

template <typename Rig>
void a_filter_takes_its_identifier_in_its_format_only(Rig& rig) {
    const std::array<hal::CanFilter, 1> standard{{{0x123, 0x7FF, false}}};
    const std::array<hal::CanFilter, 1> extended{{{0x123, 0x1FFF'FFFF, true}}};
    EXPECT_THAT(rig.bus(1).set_filters(standard));
    EXPECT_THAT(rig.bus(2).set_filters(extended));
    hal::CanFrame frame = make_frame(0x123, 1);
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(frame));
    frame.remote = true;  // judged like data
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(frame));
    for (const std::uint32_t near : {0x122U, 0x124U, 0x323U, 0x0U, 0x7FFU}) {
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(near, 1)));
    }
    rig.settle();
    EXPECT_EQUAL(2, drain(rig.bus(1)));
    EXPECT_EQUAL(0, drain(rig.bus(2)));
    for (const std::uint32_t id : {0x123U, 0x1123U, 0x0400'0123U}) {
        frame = make_frame(id, 1);
        frame.extended = true;
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(frame));
    }
    rig.settle();
    EXPECT_EQUAL(0, drain(rig.bus(1)));
    EXPECT_EQUAL(1, drain(rig.bus(2)));
}

template <typename Rig>
void masks_accept_exactly_the_identifiers_they_describe(Rig& rig) {
    // A node's 32 command codes, and one more identifier: every standard identifier is tried.
    const std::array<hal::CanFilter, 2> filters{{{3U << 5, 0x7E0, false}, {0x601, 0x7FF, false}}};
    EXPECT_THAT(rig.bus(1).set_filters(filters));
    for (std::uint32_t id = 0; id < 0x800; ++id) {
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(id, 0)));
        if (id % 8 == 7) {
            rig.settle();
            const std::size_t wanted = (id >> 5) == 3 ? 8 : id == 0x607 ? 1 : 0;
            EXPECT_EQUAL(wanted, drain(rig.bus(1)));
            drain(rig.bus(2));
        }
    }
}

template <typename Rig>
void an_empty_set_of_filters_accepts_only_error_frames(Rig& rig) {
    EXPECT_THAT(rig.bus(1).set_filters({}));
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x1, 1)));
    rig.make_error_frame(0x8);
    rig.settle();
    EXPECT_EQUAL(0, drain(rig.bus(1)));
    EXPECT_THAT(rig.bus(1).statistics().error_frames >= 1);
    EXPECT_EQUAL(1, drain(rig.bus(2)));
}

template <typename Rig>
void new_filters_replace_the_old_and_leave_waiting_frames_alone(Rig& rig) {
    const std::array<hal::CanFilter, 1> first{{{0x111, 0x7FF, false}}};
    const std::array<hal::CanFilter, 1> second{{{0x222, 0x7FF, false}}};
    EXPECT_THAT(rig.bus(1).set_filters(first));
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x111, 1)));
    rig.settle();
    EXPECT_THAT(rig.bus(1).set_filters(second));
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x111, 2)));
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x222, 3)));
    rig.settle();
    hal::ReceivedFrame received;
    EXPECT_EQUAL(hal::CanStatus::ok, receive_data(rig.bus(1), received));
    EXPECT_EQUAL(1, received.frame.length);
    EXPECT_EQUAL(hal::CanStatus::ok, receive_data(rig.bus(1), received));
    EXPECT_EQUAL(3, received.frame.length);
    EXPECT_EQUAL(0, drain(rig.bus(1)));
}

template <typename Rig>
void too_many_filters_are_refused_and_the_old_set_stays(Rig& rig) {
    std::array<hal::CanFilter, 1000> many;
    many.fill(hal::CanFilter{0x222, 0x7FF, false});
    many[0].id = 0x111;
    many[31].id = 0x333;
    EXPECT_THAT(rig.bus(1).set_filters(std::span(many).first(32)));
    for (hal::CanFilter& filter : many) {
        filter.id = 0x444;
    }
    EXPECT_THAT(!rig.bus(1).set_filters(many));
    for (const std::uint32_t id : {0x111U, 0x222U, 0x333U, 0x444U}) {
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(id, 1)));
    }
    rig.settle();
    EXPECT_EQUAL(3, drain(rig.bus(1)));
}

template <typename Rig>
void statistics_count_what_was_sent_and_received(Rig& rig) {
    for (int i = 0; i < 5; ++i) {
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x50, 8)));
    }
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(2).send(make_frame(0x51, 8)));
    rig.settle();
    EXPECT_EQUAL(6, drain(rig.bus(1)));
    EXPECT_EQUAL(5, rig.bus(0).statistics().frames_sent);
    EXPECT_EQUAL(1, rig.bus(2).statistics().frames_sent);
    EXPECT_EQUAL(6, rig.bus(1).statistics().frames_received);
    EXPECT_EQUAL(0, rig.bus(0).statistics().frames_received);  // one waits, and is not counted yet
    EXPECT_EQUAL(1, drain(rig.bus(0)));
    EXPECT_EQUAL(1, rig.bus(0).statistics().frames_received);
    EXPECT_EQUAL(0, rig.bus(1).statistics().receive_overflow);
    EXPECT_EQUAL(0, rig.bus(0).statistics().send_refused);
}

template <typename Rig>
void a_full_receive_queue_keeps_the_oldest_and_counts_the_rest(Rig& rig) {
    const std::array<hal::CanFilter, 1> only{{{0x60, 0x7FF, false}}};
    EXPECT_THAT(rig.bus(1).set_filters(only));  // nothing else may take the room
    const std::size_t sent = rig.flood_frames();
    for (std::size_t i = 0; i < sent; ++i) {
        hal::CanFrame frame = make_frame(0x60, 8);
        frame.data[0] = static_cast<std::uint8_t>(i);
        frame.data[1] = static_cast<std::uint8_t>(i >> 8);
        EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(frame));
        rig.settle();
        drain(rig.bus(2));
    }
    hal::ReceivedFrame received;
    std::size_t count = 0;
    while (receive_data(rig.bus(1), received) == hal::CanStatus::ok) {
        EXPECT_EQUAL(count, std::size_t{received.frame.data[0]} + 256 * std::size_t{received.frame.data[1]});
        ++count;
    }
    EXPECT_THAT(count > 0);
    EXPECT_THAT(count < sent);
    EXPECT_THAT(arrives(rig, 0, 1, make_frame(0x60, 1)));
    const hal::CanStatistics statistics = rig.bus(1).statistics();
    // Error frames of a disturbed bus overflow like others.
    EXPECT_THAT(count + statistics.receive_overflow >= sent);
    if (statistics.error_frames == 0) {
        EXPECT_EQUAL(sent, count + statistics.receive_overflow);
    }
}

template <typename Rig>
void a_full_transmit_queue_says_would_block_and_loses_nothing(Rig& rig) {
    if (!rig.limit_transmit_queue()) {
        return;
    }
    std::size_t accepted = 0;
    hal::CanStatus status = hal::CanStatus::ok;
    while (accepted < 100'000) {
        status = rig.bus(0).send(make_frame(0x70, 8, static_cast<std::uint8_t>(accepted)));
        if (status != hal::CanStatus::ok) {
            break;
        }
        ++accepted;
    }
    EXPECT_EQUAL(hal::CanStatus::would_block, status);
    EXPECT_EQUAL(1, rig.bus(0).statistics().send_refused);
    EXPECT_EQUAL(accepted, rig.bus(0).statistics().frames_sent);
    rig.settle();
    hal::ReceivedFrame received;
    for (std::size_t i = 0; i < accepted; ++i) {
        EXPECT_EQUAL(hal::CanStatus::ok, receive_data(rig.bus(1), received));
        EXPECT_THAT(same(make_frame(0x70, 8, static_cast<std::uint8_t>(i)), received.frame));
    }
    drain(rig.bus(1));
    EXPECT_THAT(arrives(rig, 0, 1, make_frame(0x71, 8)));
}

template <typename Rig>
void an_interface_that_is_down_says_bus_down_and_comes_back(Rig& rig) {
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(1).send(make_frame(0x80, 2)));
    rig.settle();
    rig.set_down(true);
    hal::ReceivedFrame received;
    EXPECT_EQUAL(hal::CanStatus::bus_down, rig.bus(0).send(make_frame(0x81, 2)));
    EXPECT_EQUAL(1, rig.bus(0).statistics().send_refused);
    EXPECT_EQUAL(hal::CanStatus::ok,
                 receive_data(rig.bus(0), received));  // what came before can still be taken
    EXPECT_EQUAL(hal::CanStatus::bus_down, receive_data(rig.bus(0), received));
    EXPECT_EQUAL(hal::CanStatus::bus_down, receive_data(rig.bus(0), received));
    rig.set_down(false);
    EXPECT_EQUAL(hal::CanStatus::ok, rig.bus(0).send(make_frame(0x82, 2)));
    EXPECT_EQUAL(hal::CanStatus::would_block, receive_data(rig.bus(0), received));
    rig.settle();
    EXPECT_EQUAL(1, drain(rig.bus(1)));
    EXPECT_THAT(arrives(rig, 1, 0, make_frame(0x83, 2)));
}

template <typename Rig>
void error_frames_pass_the_filters_and_are_counted_apart(Rig& rig) {
    const std::array<hal::CanFilter, 1> only{{{0x90, 0x7FF, false}}};
    EXPECT_THAT(rig.bus(1).set_filters(only));
    rig.make_error_frame(0x8C);
    rig.settle();
    hal::ReceivedFrame received;
    EXPECT_EQUAL(hal::CanStatus::ok, receive(rig.bus(1), received));
    EXPECT_THAT(received.frame.error);
    EXPECT_EQUAL(0x8C, received.frame.id);
    EXPECT_THAT(!received.frame.remote && !received.frame.extended);
    EXPECT_EQUAL(1, rig.bus(1).statistics().error_frames);
    EXPECT_EQUAL(0, rig.bus(1).statistics().frames_received);
}

template <typename Rig>
void bus_off_is_counted_and_refuses_until_the_restart(Rig& rig) {
    rig.set_bus_off(true);
    rig.settle();
    hal::ReceivedFrame received;
    EXPECT_EQUAL(hal::CanStatus::ok, receive(rig.bus(0), received));
    EXPECT_THAT(received.frame.error);
    EXPECT_THAT((received.frame.id & 0x40U) != 0);
    EXPECT_EQUAL(1, rig.bus(0).statistics().bus_off);
    EXPECT_EQUAL(hal::CanStatus::bus_down, rig.bus(0).send(make_frame(0xA0, 2)));
    EXPECT_EQUAL(hal::CanStatus::bus_down, receive_data(rig.bus(0), received));
    rig.set_bus_off(false);
    rig.settle();
    EXPECT_EQUAL(hal::CanStatus::ok, receive(rig.bus(0), received));
    EXPECT_THAT(received.frame.error);
    EXPECT_THAT((received.frame.id & 0x100U) != 0);
    EXPECT_EQUAL(1, rig.bus(0).statistics().bus_off);
    drain(rig.bus(1));
    EXPECT_THAT(arrives(rig, 0, 1, make_frame(0xA1, 2)));
}

// X(name) for each of them.
#define WHEELWRIGHT_CAN_BUS_CONTRACT(X)                               \
    X(every_length_arrives_unchanged_at_all_others_once)              \
    X(the_ends_of_both_identifier_ranges_arrive)                      \
    X(own_frames_are_not_received)                                    \
    X(a_frame_waits_until_it_has_left)                                \
    X(an_empty_bus_says_would_block)                                  \
    X(one_senders_frames_keep_their_order)                            \
    X(remote_frames_arrive_as_such)                                   \
    X(fd_frames_arrive_on_an_fd_bus_and_are_invalid_on_a_classic_one) \
    X(malformed_frames_are_invalid_and_reach_nobody)                  \
    X(timestamps_lie_between_send_and_receive_and_do_not_go_back)     \
    X(a_filter_takes_its_identifier_in_its_format_only)               \
    X(masks_accept_exactly_the_identifiers_they_describe)             \
    X(an_empty_set_of_filters_accepts_only_error_frames)              \
    X(new_filters_replace_the_old_and_leave_waiting_frames_alone)     \
    X(too_many_filters_are_refused_and_the_old_set_stays)             \
    X(statistics_count_what_was_sent_and_received)                    \
    X(a_full_receive_queue_keeps_the_oldest_and_counts_the_rest)      \
    X(a_full_transmit_queue_says_would_block_and_loses_nothing)       \
    X(an_interface_that_is_down_says_bus_down_and_comes_back)         \
    X(error_frames_pass_the_filters_and_are_counted_apart)            \
    X(bus_off_is_counted_and_refuses_until_the_restart)

}  // namespace wheelwright::contract
