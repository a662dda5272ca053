#include "sim_hal/in_process_bus.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/contract/can_bus_contract.hpp"
#include "tests/hal/in_process_rig.hpp"

using namespace wheelwright;
using contract::make_frame;
using sim::FaultAction;
using sim::FaultRule;
using sim::InProcessBus;
using sim::InProcessBusOptions;

namespace {

// Remembers what ended on the wire, in a fixed place: CppUTest counts what a test leaves allocated.
class Witness final : public sim::BusTap {
  public:
    struct Seen {
        std::uint32_t id;
        bool error;
        bool dropped;
        std::size_t sender;
        std::int64_t start_ns;
        std::int64_t end_ns;
        std::uint8_t first_byte;
    };

    void on_frame(const sim::WireEvent& event) override {
        if (count < seen.size()) {
            seen[count] = Seen{event.frame->id,
                               event.frame->error,
                               event.dropped,
                               event.sender,
                               event.start_ns,
                               event.end_ns,
                               event.frame->length > 0 ? event.frame->data[0] : std::uint8_t{0}};
        }
        ++count;
    }

    std::array<Seen, 600> seen{};
    std::size_t count = 0;
};

constexpr std::int64_t start_ns = 1'000'000'000;  // where InProcessRig's clock begins

hal::CanFrame extended(hal::CanFrame frame) {
    frame.extended = true;
    return frame;
}

hal::CanFrame remote(hal::CanFrame frame) {
    frame.remote = true;
    return frame;
}

}  // namespace

TEST_GROUP(InProcessBus){};

// Worst-case bits, three of interframe space included: Davis, Burns, Bril, Lukkien 2007, equations 2 and 3.
TEST(InProcessBus, a_classic_frame_takes_the_published_worst_case_time) {
    const std::array<std::array<int, 3>, 5> table{
        {{0, 55, 80}, {1, 65, 90}, {4, 95, 120}, {6, 115, 140}, {8, 135, 160}}};
    for (const std::uint32_t rate : {125'000U, 500'000U, 1'000'000U}) {
        InProcessBusOptions options;
        options.bit_rate = rate;
        InProcessRig rig(options);
        const std::int64_t bit_ns = 1'000'000'000 / rate;
        for (const auto& [length, bits, extended_bits] : table) {
            const hal::CanFrame frame = make_frame(1, static_cast<std::uint8_t>(length));
            LONGS_EQUAL((bits - 3) * bit_ns, rig.wire().wire_time_ns(frame));
            LONGS_EQUAL((extended_bits - 3) * bit_ns, rig.wire().wire_time_ns(extended(frame)));
        }
        LONGS_EQUAL(52 * bit_ns, rig.wire().wire_time_ns(remote(make_frame(1, 8))));
    }
}

TEST(InProcessBus, random_stuffing_is_what_counting_stuff_bits_gives) {
    InProcessBusOptions options;
    options.stuffing = sim::Stuffing::random_data;
    InProcessRig rig(options);
    std::uint32_t state = 12345;
    for (const int length : {0, 4, 8}) {
        const int stuffed = 34 + 8 * length;
        long total = 0;
        constexpr int trials = 20'000;
        for (int trial = 0; trial < trials; ++trial) {
            int run = 0;
            int last = -1;
            for (int i = 0; i < stuffed; ++i) {
                state = state * 1664525U + 1013904223U;
                const int bit = static_cast<int>(state >> 31);
                run = bit == last ? run + 1 : 1;
                last = bit;
                if (run == 5) {
                    ++total;
                    last = 1 - bit;
                    run = 1;
                }
            }
        }
        const double mean_bits = stuffed + 10 + static_cast<double>(total) / trials;
        const double ours =
            static_cast<double>(rig.wire().wire_time_ns(make_frame(1, static_cast<std::uint8_t>(length)))) /
            1000;
        std::printf("%d bytes, random data: %.2f bits counted, %.0f bits modelled\n", length, mean_bits,
                    ours);
        CHECK(std::fabs(ours - mean_bits) < 0.5);
    }
}

// A moteus exchange, 48 bytes out and 24 back at 1 and 5 Mbit/s, takes about a quarter of a millisecond.
TEST(InProcessBus, fd_frames_with_bit_rate_switch_take_the_time_of_both_rates) {
    InProcessBusOptions options;
    options.fd = true;
    InProcessRig rig(options);
    hal::CanFrame out = extended(make_frame(0x8001, 48));
    out.fd = out.bit_rate_switch = true;
    hal::CanFrame back = make_frame(0x100, 24);
    back.fd = back.bit_rate_switch = true;
    const std::int64_t both_ns = rig.wire().wire_time_ns(out) + rig.wire().wire_time_ns(back);
    CHECK(both_ns > 220'000);
    CHECK(both_ns < 270'000);
    out.bit_rate_switch = false;
    CHECK(rig.wire().wire_time_ns(out) > 384'000);  // 48 bytes alone at 1 Mbit/s
}

// Counted by hand from the frame's layout: header, ESI and DLC and data, a stuff bit for every four of those
// after the first; stuff count and CRC with their fixed stuff bits; CRC delimiter, acknowledge and its
// delimiter, end.
TEST(InProcessBus, an_fd_frame_takes_the_time_of_its_fields) {
    InProcessBusOptions options;
    options.fd = true;
    InProcessRig rig(options);
    struct Case {
        bool extended;
        std::uint8_t length;
        int bits;
    };
    for (const Case& one :
         {Case{false, 0, 17 + 5 + 5 + (4 + 17 + 6) + 10}, Case{false, 8, 17 + 69 + 21 + 27 + 10},
          Case{false, 16, 17 + 133 + 37 + 27 + 10}, Case{false, 20, 17 + 165 + 45 + 32 + 10},
          Case{false, 64, 17 + 517 + 133 + (4 + 21 + 7) + 10}, Case{true, 8, 36 + 69 + 26 + 27 + 10}}) {
        hal::CanFrame frame = make_frame(1, one.length);
        frame.extended = one.extended;
        frame.fd = true;
        LONGS_EQUAL(one.bits * 1000, rig.wire().wire_time_ns(frame));
    }
    // With the switch, only header (with its own stuff bits) and the last ten bits are at the slow rate.
    hal::CanFrame frame = make_frame(1, 8);
    frame.fd = frame.bit_rate_switch = true;
    LONGS_EQUAL((17 + 4 + 10) * 1000 + (69 + 17 + 27) * 200, rig.wire().wire_time_ns(frame));
    frame.extended = true;
    LONGS_EQUAL((36 + 8 + 10) * 1000 + (69 + 18 + 27) * 200, rig.wire().wire_time_ns(frame));
}

TEST(InProcessBus, frames_follow_each_other_with_three_bits_between_and_stamps_are_their_ends) {
    InProcessRig rig;
    Witness witness;
    rig.wire().add_tap(witness);
    for (int i = 0; i < 3; ++i) {
        rig.bus(0).send(make_frame(0x10, 8));
    }
    rig.settle();
    LONGS_EQUAL(3, witness.count);
    hal::ReceivedFrame received;
    for (int i = 0; i < 3; ++i) {
        LONGS_EQUAL(start_ns + i * 135'000, witness.seen[static_cast<std::size_t>(i)].start_ns);
        CHECK(rig.bus(1).receive(received) == hal::CanStatus::ok);
        LONGS_EQUAL(start_ns + i * 135'000 + 132'000, received.timestamp_ns);
    }
    LONGS_EQUAL(3 * 135'000, rig.wire().totals().busy_ns);
    LONGS_EQUAL(3, rig.wire().totals().frames);
}

TEST(InProcessBus, nothing_is_received_before_its_last_bit) {
    InProcessRig rig;
    hal::ReceivedFrame received;
    rig.bus(0).send(make_frame(0x10, 8));
    LONGS_EQUAL(start_ns + 132'000, rig.wire().next_event_ns());
    rig.clock().advance_to(start_ns + 131'999);
    CHECK(rig.bus(1).receive(received) == hal::CanStatus::would_block);
    LONGS_EQUAL(start_ns + 132'000, rig.wire().next_event_ns());
    rig.clock().advance_to(start_ns + 132'000);
    CHECK(rig.bus(1).receive(received) == hal::CanStatus::ok);
    CHECK(rig.wire().next_event_ns() == InProcessBus::never_ns);
}

TEST(InProcessBus, of_frames_queued_at_one_instant_the_lowest_arbitration_field_wins) {
    InProcessRig rig;
    Witness witness;
    rig.wire().add_tap(witness);
    // Endpoint order is against the priority; one identifier's formats in the order of ISO 11898-1: data
    // before remote, standard before extended with the same first eleven bits.
    rig.bus(0).send(extended(make_frame(0x123U << 18, 0)));
    rig.bus(1).send(remote(make_frame(0x123, 0)));
    rig.bus(2).send(make_frame(0x123, 0));
    rig.settle();
    LONGS_EQUAL(2, witness.seen[0].sender);
    LONGS_EQUAL(1, witness.seen[1].sender);
    LONGS_EQUAL(0, witness.seen[2].sender);
    // A high extended identifier whose first eleven bits are low beats a standard one.
    rig.bus(0).send(make_frame(0x200, 0));
    rig.bus(1).send(extended(make_frame((0x1FFU << 18) + 0x3FFFF, 0)));
    rig.bus(2).send(make_frame(0x201, 0));
    rig.settle();
    LONGS_EQUAL(1, witness.seen[3].sender);
    LONGS_EQUAL(0, witness.seen[4].sender);
    LONGS_EQUAL(2, witness.seen[5].sender);
}

TEST(InProcessBus, of_one_identifier_data_beats_remote_and_then_the_lower_endpoint_wins) {
    InProcessRig rig;
    Witness witness;
    rig.wire().add_tap(witness);
    rig.bus(0).send(extended(remote(make_frame(0x123'4567, 0))));
    rig.bus(2).send(extended(make_frame(0x123'4567, 0)));
    rig.bus(1).send(extended(make_frame(0x123'4567, 0)));
    rig.settle();
    LONGS_EQUAL(1, witness.seen[0].sender);
    LONGS_EQUAL(2, witness.seen[1].sender);
    LONGS_EQUAL(0, witness.seen[2].sender);
}

TEST(InProcessBus, who_sends_at_the_instant_the_wire_becomes_free_takes_part) {
    InProcessRig rig;
    Witness witness;
    rig.wire().add_tap(witness);
    rig.bus(0).send(make_frame(0x500, 8));
    rig.bus(0).send(make_frame(0x501, 8));
    rig.clock().advance_to(start_ns + 135'000);
    rig.bus(1).send(make_frame(0x100, 8));
    rig.settle();
    LONGS_EQUAL(0x100, witness.seen[1].id);
    LONGS_EQUAL(start_ns + 135'000, witness.seen[1].start_ns);
}

TEST(InProcessBus, the_announced_event_changes_with_who_joins_at_the_same_instant) {
    InProcessRig rig;
    rig.bus(0).send(make_frame(0x500, 8));
    LONGS_EQUAL(start_ns + 132'000, rig.wire().next_event_ns());
    rig.bus(1).send(make_frame(0x100, 0));
    LONGS_EQUAL(start_ns + 52'000, rig.wire().next_event_ns());
    rig.wire().set_down(1, true);
    LONGS_EQUAL(start_ns + 132'000, rig.wire().next_event_ns());
    rig.settle();
    hal::ReceivedFrame received;
    CHECK(rig.bus(2).receive(received) == hal::CanStatus::ok);
    LONGS_EQUAL(0x500, received.frame.id);
}

TEST(InProcessBus, new_filters_do_not_judge_what_has_ended_on_the_wire_already) {
    InProcessRig rig;
    rig.bus(0).send(make_frame(0x500, 8));
    rig.clock().advance_to(start_ns + 1'000'000);  // nobody looks at the bus here
    CHECK(rig.bus(1).set_filters({}));
    LONGS_EQUAL(1, contract::drain(rig.bus(1)));
}

TEST(InProcessBus, being_down_and_being_bus_off_are_two_reasons_and_both_must_go) {
    InProcessRig rig;
    const hal::CanFrame frame = make_frame(0x10, 1);
    rig.wire().set_down(0, true);
    rig.wire().set_bus_off(0);
    rig.wire().recover(0);
    CHECK(!contract::arrives(rig, 1, 0, frame));
    CHECK(!contract::arrives(rig, 0, 1, frame));
    rig.wire().set_bus_off(0);
    rig.wire().set_down(0, false);
    CHECK(!contract::arrives(rig, 1, 0, frame));
    CHECK(!contract::arrives(rig, 0, 1, frame));
    rig.wire().recover(0);
    CHECK(contract::arrives(rig, 1, 0, frame));
    CHECK(contract::arrives(rig, 0, 1, frame));
}

TEST(InProcessBus, a_frame_on_the_wire_is_not_interrupted_but_a_late_one_may_pass_the_queue) {
    InProcessRig rig;
    Witness witness;
    rig.wire().add_tap(witness);
    rig.bus(0).send(make_frame(0x500, 8));
    rig.bus(0).send(make_frame(0x501, 8));
    rig.clock().advance_to(start_ns + 100'000);
    rig.bus(1).send(make_frame(0x001, 8));
    rig.settle();
    LONGS_EQUAL(0x500, witness.seen[0].id);
    LONGS_EQUAL(0x001, witness.seen[1].id);
    LONGS_EQUAL(start_ns + 135'000, witness.seen[1].start_ns);
    LONGS_EQUAL(0x501, witness.seen[2].id);
}

TEST(InProcessBus, the_result_does_not_depend_on_how_often_somebody_looks) {
    Witness coarse;
    Witness fine;
    for (Witness* witness : {&coarse, &fine}) {
        InProcessRig rig;
        rig.wire().add_tap(*witness);
        hal::ReceivedFrame received;
        for (int i = 0; i < 100; ++i) {
            const std::int64_t now_ns = start_ns + i * 250'000;
            if (witness == &fine) {
                for (std::int64_t at_ns = now_ns - 250'000; at_ns < now_ns; at_ns += 7'000) {
                    rig.clock().advance_to(at_ns);
                    rig.bus(2).receive(received);
                }
            }
            rig.clock().advance_to(now_ns);
            rig.bus(0).send(make_frame(0x300 + static_cast<std::uint32_t>(i * 37 % 100), 8));
            rig.bus(1).send(make_frame(0x300 + static_cast<std::uint32_t>(i * 53 % 100), 5));
        }
        rig.settle();
    }
    LONGS_EQUAL(200, coarse.count);
    LONGS_EQUAL(coarse.count, fine.count);
    for (std::size_t i = 0; i < coarse.count; ++i) {
        LONGS_EQUAL(coarse.seen[i].id, fine.seen[i].id);
        LONGS_EQUAL(coarse.seen[i].end_ns, fine.seen[i].end_ns);
    }
}

TEST(InProcessBus, receive_latency_stays_in_its_bounds_and_leaves_the_stamp_alone) {
    InProcessBusOptions options;
    options.receive_latency_ns = 40'000;
    options.receive_jitter_ns = 60'000;
    InProcessRig rig(options);
    double sum_ns = 0;
    std::int64_t least_ns = InProcessBus::never_ns;
    std::int64_t most_ns = 0;
    constexpr int frames = 2000;
    for (int i = 0; i < frames; ++i) {
        const std::int64_t sent_ns = rig.now_ns();
        rig.bus(0).send(make_frame(0x10, 8));
        rig.clock().advance_to(rig.wire().next_event_ns());
        hal::ReceivedFrame received;
        const std::int64_t at_ns = rig.bus(1).next_receive_ns();
        rig.clock().advance_to(at_ns - 1);
        CHECK(rig.bus(1).receive(received) == hal::CanStatus::would_block);
        rig.clock().advance_to(at_ns);
        CHECK(rig.bus(1).receive(received) == hal::CanStatus::ok);
        LONGS_EQUAL(sent_ns + 132'000, received.timestamp_ns);
        const std::int64_t latency_ns = at_ns - received.timestamp_ns;
        least_ns = std::min(least_ns, latency_ns);
        most_ns = std::max(most_ns, latency_ns);
        sum_ns += static_cast<double>(latency_ns);
        rig.clock().advance_to(rig.now_ns() + 1'000'000);
    }
    std::printf("latency 40..100 us: %.3f .. %.3f us, mean %.2f us\n", static_cast<double>(least_ns) / 1e3,
                static_cast<double>(most_ns) / 1e3, sum_ns / frames / 1e3);
    CHECK(least_ns >= 40'000);
    CHECK(most_ns <= 100'000);
    CHECK(least_ns < 41'000);
    CHECK(most_ns > 99'000);
    CHECK(std::fabs(sum_ns / frames - 70'000) < 1'500);  // 60 us / sqrt(12 * 2000) = 0.39 us standard error
    LONGS_EQUAL(InProcessBus::never_ns, rig.bus(1).next_receive_ns());
}

TEST(InProcessBus, one_seed_gives_one_course_of_events_and_another_gives_another) {
    std::array<Witness, 3> witnesses;
    std::array<std::int64_t, 3> last_ns{};
    const std::array<std::uint64_t, 3> seeds{5, 5, 6};
    for (std::size_t run = 0; run < 3; ++run) {
        InProcessBusOptions options;
        options.seed = seeds[run];
        options.receive_jitter_ns = 50'000;
        InProcessRig rig(options);
        rig.wire().add_tap(witnesses[run]);
        FaultRule rule;
        rule.probability = 0.1;
        for (const FaultAction action : {FaultAction::drop, FaultAction::corrupt, FaultAction::destroy}) {
            rule.action = action;
            CHECK(rig.wire().add_fault(rule));
        }
        for (std::uint8_t i = 0; i < 200; ++i) {
            rig.bus(0).send(make_frame(0x40, 8, i));
            rig.settle();
        }
        last_ns[run] = rig.now_ns();
    }
    LONGS_EQUAL(witnesses[0].count, witnesses[1].count);
    LONGS_EQUAL(last_ns[0], last_ns[1]);
    bool differ = witnesses[0].count != witnesses[2].count;
    for (std::size_t i = 0; i < witnesses[0].count; ++i) {
        LONGS_EQUAL(witnesses[0].seen[i].end_ns, witnesses[1].seen[i].end_ns);
        LONGS_EQUAL(witnesses[0].seen[i].first_byte, witnesses[1].seen[i].first_byte);
        CHECK_EQUAL(witnesses[0].seen[i].dropped, witnesses[1].seen[i].dropped);
        differ = differ || witnesses[0].seen[i].end_ns != witnesses[2].seen[i].end_ns;
    }
    CHECK(differ);
}

TEST(InProcessBus, exactly_the_named_frame_is_dropped_and_its_sender_does_not_know) {
    InProcessRig rig;
    Witness witness;
    rig.wire().add_tap(witness);
    FaultRule rule;
    rule.id = 0x20;
    rule.mask = 0x7FF;
    rule.skip = 2;
    rule.count = 1;
    CHECK(rig.wire().add_fault(rule));
    for (std::uint8_t i = 0; i < 5; ++i) {
        rig.bus(0).send(make_frame(0x21, 1, i));  // does not match
        rig.bus(0).send(make_frame(0x20, 1, i));
    }
    rig.settle();
    LONGS_EQUAL(10, rig.bus(0).statistics().frames_sent);
    LONGS_EQUAL(9, contract::drain(rig.bus(1)));
    LONGS_EQUAL(9, contract::drain(rig.bus(2)));
    LONGS_EQUAL(1, rig.wire().totals().dropped);
    for (std::size_t i = 0; i < 10; ++i) {
        CHECK_EQUAL(i == 5, witness.seen[i].dropped);
    }
}

TEST(InProcessBus, a_corrupted_frame_arrives_with_one_bit_flipped) {
    InProcessRig rig;
    FaultRule rule;
    rule.action = FaultAction::corrupt;
    CHECK(rig.wire().add_fault(rule));
    for (std::uint8_t i = 0; i < 50; ++i) {
        const hal::CanFrame sent = make_frame(0x30, 5, i);
        rig.bus(0).send(sent);
        rig.settle();
        hal::ReceivedFrame received;
        CHECK(rig.bus(1).receive(received) == hal::CanStatus::ok);
        int flipped = 0;
        for (std::size_t k = 0; k < 5; ++k) {
            flipped += __builtin_popcount(static_cast<unsigned>(sent.data[k] ^ received.frame.data[k]));
        }
        LONGS_EQUAL(1, flipped);
    }
    rig.bus(0).send(make_frame(0x30, 0));
    rig.settle();
    LONGS_EQUAL(50, rig.wire().totals().corrupted);
    rig.wire().clear_faults();
    contract::drain(rig.bus(1));
    CHECK(contract::arrives(rig, 0, 1, make_frame(0x30, 5)));
}

TEST(InProcessBus, a_destroyed_frame_is_seen_by_all_and_repeated_at_once) {
    InProcessRig rig;
    FaultRule rule;
    rule.action = FaultAction::destroy;
    rule.count = 1;
    CHECK(rig.wire().add_fault(rule));
    rig.bus(0).send(make_frame(0x40, 8));
    rig.settle();
    hal::ReceivedFrame received;
    for (const int index : {0, 1, 2}) {
        CHECK(rig.bus(index).receive(received) == hal::CanStatus::ok);
        CHECK(received.frame.error);
    }
    CHECK(rig.bus(1).receive(received) == hal::CanStatus::ok);
    CHECK(contract::same(make_frame(0x40, 8), received.frame));
    // 132 bits, 20 of the error frame, 3 between, and the frame again.
    LONGS_EQUAL(start_ns + (132 + 20 + 3 + 132) * 1000, received.timestamp_ns);
    LONGS_EQUAL(1, rig.wire().totals().destroyed);
}

TEST(InProcessBus, a_sender_that_is_always_destroyed_ends_bus_off_and_the_others_go_on) {
    InProcessRig rig;
    FaultRule rule;
    rule.action = FaultAction::destroy;
    rule.id = 0x41;
    rule.mask = 0x7FF;
    CHECK(rig.wire().add_fault(rule));
    rig.bus(0).send(make_frame(0x41, 8));
    rig.bus(0).send(make_frame(0x42, 8));
    rig.bus(1).send(make_frame(0x43, 8));
    rig.settle();
    LONGS_EQUAL(32, rig.wire().totals().destroyed);  // ISO 11898-1: 8 each time, off above 255
    LONGS_EQUAL(1, rig.bus(0).statistics().bus_off);
    CHECK(rig.bus(0).send(make_frame(0x42, 8)) == hal::CanStatus::bus_down);
    LONGS_EQUAL(1, contract::drain(rig.bus(2)));  // 0x43; the queue of the first is lost
    rig.wire().recover(0);
    CHECK(contract::arrives(rig, 0, 2, make_frame(0x42, 8)));
    // The error counter begins again.
    rig.wire().clear_faults();
    rule.count = 1;
    CHECK(rig.wire().add_fault(rule));
    CHECK(contract::arrives(rig, 0, 2, make_frame(0x41, 8)));
    LONGS_EQUAL(1, rig.bus(0).statistics().bus_off);
}

TEST(InProcessBus, a_probability_hits_its_share) {
    InProcessRig rig;
    FaultRule rule;
    rule.probability = 0.3;
    CHECK(rig.wire().add_fault(rule));
    constexpr int frames = 10'000;
    for (int i = 0; i < frames; ++i) {
        rig.bus(0).send(make_frame(0x50, 0));
        rig.settle();
        contract::drain(rig.bus(1));
    }
    const double share = static_cast<double>(rig.wire().totals().dropped) / frames;
    std::printf("dropped %.4f of the frames, 0.3 wanted\n", share);
    CHECK(std::fabs(share - 0.3) < 4 * std::sqrt(0.3 * 0.7 / frames));
    LONGS_EQUAL(frames,
                static_cast<long>(rig.wire().totals().dropped + rig.bus(1).statistics().frames_received));
}

TEST(InProcessBus, an_endpoint_that_goes_down_in_mid_frame_frees_the_wire_and_loses_its_queue) {
    InProcessRig rig;
    rig.bus(0).send(make_frame(0x60, 8));
    rig.bus(0).send(make_frame(0x61, 8));
    rig.clock().advance_to(start_ns + 50'000);
    rig.wire().set_down(0, true);
    rig.bus(1).send(make_frame(0x62, 8));
    rig.settle();
    hal::ReceivedFrame received;
    CHECK(rig.bus(2).receive(received) == hal::CanStatus::ok);
    LONGS_EQUAL(0x62, received.frame.id);
    // 20 bits of error flag and delimiter, 3 between.
    LONGS_EQUAL(start_ns + 50'000 + 23'000 + 132'000, received.timestamp_ns);
    CHECK(rig.bus(2).receive(received) == hal::CanStatus::would_block);
    rig.wire().set_down(0, false);
    CHECK(contract::arrives(rig, 0, 2, make_frame(0x63, 8)));
    LONGS_EQUAL(0, contract::drain(rig.bus(0)));  // it missed 0x62
}

TEST(InProcessBus, every_frame_is_received_dropped_or_counted_as_lost) {
    // Six endpoints send at random; per receiver, the books must balance.
    sim::VirtualClock clock;
    InProcessBusOptions options;
    options.receive_capacity = 40;
    options.transmit_capacity = 2;
    options.receive_latency_ns = 10'000;
    options.receive_jitter_ns = 300'000;
    InProcessBus bus(clock, InProcessBus::max_endpoints, options);
    FaultRule rule;
    rule.probability = 0.05;
    bus.add_fault(rule);
    std::array<std::uint64_t, InProcessBus::max_endpoints> received_from{};
    std::uint32_t state = 99;
    const auto random = [&state](std::uint32_t limit) {
        state = state * 1664525U + 1013904223U;
        return (state >> 8) % limit;
    };
    std::uint64_t refused = 0;
    for (int step = 0; step < 20'000; ++step) {
        clock.advance_to(clock.now_ns() + random(150'000));
        const std::size_t who = random(InProcessBus::max_endpoints);
        if (random(3) > 0) {
            refused +=
                bus.endpoint(who).send(make_frame(random(0x800), static_cast<std::uint8_t>(random(9)))) ==
                hal::CanStatus::would_block;
        } else {
            hal::ReceivedFrame frame;
            for (std::uint32_t n = random(30);
                 n > 0 && bus.endpoint(who).receive(frame) == hal::CanStatus::ok; --n) {
                ++received_from[who];
            }
        }
    }
    clock.advance_to(clock.now_ns() + 1'000'000'000);
    std::uint64_t sent = 0;
    for (std::size_t i = 0; i < InProcessBus::max_endpoints; ++i) {
        sent += bus.endpoint(i).statistics().frames_sent;
    }
    LONGS_EQUAL(sent, bus.totals().frames);
    for (std::size_t i = 0; i < InProcessBus::max_endpoints; ++i) {
        received_from[i] += contract::drain(bus.endpoint(i));
        const hal::CanStatistics statistics = bus.endpoint(i).statistics();
        LONGS_EQUAL(received_from[i], statistics.frames_received);
        // Dropped frames of its own are not missing here, so this is a bound from both sides.
        const std::uint64_t others = sent - statistics.frames_sent;
        const std::uint64_t accounted = statistics.frames_received + statistics.receive_overflow;
        CHECK(accounted <= others);
        CHECK(accounted + bus.totals().dropped >= others);
    }
    std::printf("%llu frames sent, %llu refused, %llu dropped, %llu lost at endpoint 0\n",
                static_cast<unsigned long long>(sent), static_cast<unsigned long long>(refused),
                static_cast<unsigned long long>(bus.totals().dropped),
                static_cast<unsigned long long>(bus.endpoint(0).statistics().receive_overflow));
    CHECK(refused > 0);
    CHECK(bus.endpoint(0).statistics().receive_overflow > 0);
}

TEST(InProcessBus, its_tables_are_finite_and_say_so) {
    InProcessRig rig;
    Witness witness;
    for (std::size_t i = 0; i < InProcessBus::max_taps; ++i) {
        CHECK(rig.wire().add_tap(witness));
    }
    CHECK(!rig.wire().add_tap(witness));
    for (std::size_t i = 0; i < InProcessBus::max_faults; ++i) {
        CHECK(rig.wire().add_fault(FaultRule{}));
    }
    CHECK(!rig.wire().add_fault(FaultRule{}));
    sim::VirtualClock clock;
    LONGS_EQUAL(1, InProcessBus(clock, 0).endpoint_count());
    LONGS_EQUAL(InProcessBus::max_endpoints, InProcessBus(clock, 100).endpoint_count());
}
