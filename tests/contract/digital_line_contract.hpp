// What every pair of hal::DigitalInput and DigitalOutput does. A rig provides
//     hal::DigitalInput& input();
//     hal::DigitalOutput& output();
//     bool drive_input(bool active);         the world drives the wire; false: it cannot here
//     hal::LineLevel output_level();         what the world sees; unknown: it cannot look
#pragma once

#include "hal/digital_line.hpp"
#include "tests/contract/expect.hpp"

namespace wheelwright::contract {

template <typename Rig>
void an_input_shows_the_level_of_its_wire(Rig& rig) {
    EXPECT_THAT(rig.input().read() != hal::LineLevel::unknown);
    for (const bool active : {true, true, false, true, false, false}) {
        if (rig.drive_input(active)) {
            EXPECT_EQUAL(active ? hal::LineLevel::active : hal::LineLevel::inactive, rig.input().read());
        }
    }
}

template <typename Rig>
void reading_changes_nothing(Rig& rig) {
    const hal::LineLevel level = rig.input().read();
    for (int i = 0; i < 100; ++i) {
        EXPECT_EQUAL(level, rig.input().read());
    }
}

template <typename Rig>
void an_output_takes_every_level_and_repeats_it(Rig& rig) {
    for (const bool active : {true, false, false, true, true, false}) {
        EXPECT_THAT(rig.output().write(active));
        const hal::LineLevel seen = rig.output_level();
        if (seen != hal::LineLevel::unknown) {
            EXPECT_EQUAL(active ? hal::LineLevel::active : hal::LineLevel::inactive, seen);
        }
    }
}

#define WHEELWRIGHT_DIGITAL_LINE_CONTRACT(X) \
    X(an_input_shows_the_level_of_its_wire)  \
    X(reading_changes_nothing)               \
    X(an_output_takes_every_level_and_repeats_it)

}  // namespace wheelwright::contract
