#include "sim_hal/faulty_bus.hpp"

#include <vector>

#include "sim_hal/in_process_bus.hpp"
#include "sim_hal/virtual_clock.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using Deal = sim::FaultyBus::Deal;

namespace {

struct Rig {
    sim::VirtualClock clock;
    sim::InProcessBus bus{clock, 2};
    sim::FaultyBus faulty{bus.endpoint(0)};
    std::int64_t now_ns = 0;

    static hal::CanFrame frame(std::uint32_t id) {
        hal::CanFrame frame;
        frame.id = id;
        frame.length = 1;
        frame.data = {};
        return frame;
    }
    // Identifiers, in the order in which they are received.
    static std::vector<std::uint32_t> received(hal::CanBus& from) {
        std::vector<std::uint32_t> ids;
        hal::ReceivedFrame frame;
        while (from.receive(frame) == hal::CanStatus::ok) ids.push_back(frame.frame.id);
        return ids;
    }
    void settle() { clock.advance_to(now_ns += 10'000'000); }
    void send_three() {
        for (const std::uint32_t id : {1U, 2U, 3U}) bus.endpoint(1).send(frame(id));
        settle();
    }
};

using Ids = std::vector<std::uint32_t>;

}  // namespace

TEST_GROUP(FaultyBus){};

TEST(FaultyBus, hands_everything_on_without_a_rule) {
    Rig rig;
    rig.send_three();
    CHECK((Rig::received(rig.faulty) == Ids{1, 2, 3}));
    CHECK(rig.faulty.send(Rig::frame(7)) == hal::CanStatus::ok);
    rig.settle();
    CHECK((Rig::received(rig.bus.endpoint(1)) == Ids{7}));
}

TEST(FaultyBus, what_is_received_is_lost_doubled_or_late) {
    const auto with = [](Deal deal) {
        Rig rig;
        rig.faulty.on_receive([deal](hal::ReceivedFrame& r) { return r.frame.id == 2 ? deal : Deal::pass; });
        rig.send_three();
        return Rig::received(rig.faulty);
    };
    CHECK((with(Deal::lose) == Ids{1, 3}));
    CHECK((with(Deal::twice) == Ids{1, 2, 2, 3}));
    CHECK((with(Deal::later) == Ids{1, 3, 2}));
}

TEST(FaultyBus, the_last_frame_that_is_late_comes_behind_the_next_one) {
    Rig rig;
    rig.faulty.on_receive([](hal::ReceivedFrame& r) { return r.frame.id == 3 ? Deal::later : Deal::pass; });
    rig.send_three();
    CHECK((Rig::received(rig.faulty) == Ids{1, 2}));
    rig.faulty.on_receive({});
    rig.bus.endpoint(1).send(Rig::frame(4));
    rig.settle();
    CHECK((Rig::received(rig.faulty) == Ids{4, 3}));
}

TEST(FaultyBus, a_rule_changes_frame_and_time) {
    Rig rig;
    rig.faulty.on_receive([](hal::ReceivedFrame& r) {
        r.frame.data[0] = 9;
        r.timestamp_ns = -5;
        return Deal::pass;
    });
    rig.send_three();
    hal::ReceivedFrame frame;
    CHECK(rig.faulty.receive(frame) == hal::CanStatus::ok);
    CHECK_EQUAL(9, frame.frame.data[0]);
    CHECK_EQUAL(-5, frame.timestamp_ns);
}

TEST(FaultyBus, what_is_sent_is_lost_doubled_or_refused) {
    const auto with = [](Deal deal, hal::CanStatus says, const Ids& arrives) {
        Rig rig;
        rig.faulty.on_send([deal](hal::ReceivedFrame&) { return deal; });
        CHECK(rig.faulty.send(Rig::frame(7)) == says);
        rig.settle();
        CHECK(Rig::received(rig.bus.endpoint(1)) == arrives);
        CHECK_EQUAL(deal == Deal::refuse ? 1U : 0U, rig.faulty.statistics().send_refused);
    };
    with(Deal::lose, hal::CanStatus::ok, {});
    with(Deal::twice, hal::CanStatus::ok, {7, 7});
    with(Deal::refuse, hal::CanStatus::would_block, {});
}
