// The kinds of fault: one row each, with how it is done and what must follow. A kind is added by its row.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "tools/torture/scene.hpp"

namespace wheelwright::tools {

enum class Expect : std::uint8_t {
    stops,   // zero torque within the bound, a fault with one of the names
    serves,  // goes on as if nothing were, but for `deviation_m`
    either,  // one of the two, and no rule broken; a fault has one of the names
    rests,   // the mode idle and zero torque within the bound, and no fault
    obeys,   // the mode may change as asked; no rule broken, and a fault has one of the names
};

enum class From : std::uint8_t {
    harm,  // the bound counts from the injection
    told,  // from the moment at which the firmware is told, or at which it could have known
    lie,   // from the moment at which an encoder is farther from the truth than a coarse one may be
};

struct TortureKind {
    std::string_view name;
    std::string_view what;  // how it is done
    Expect expect = Expect::stops;
    std::string_view names;  // of the faults that are true names for it, with commas; "*": any
    void (*inject)(Scene&) = nullptr;
    void (*each)(Scene&) = nullptr;             // after each cycle, until the recovery
    double (*bound_s)(const Scene&) = nullptr;  // to zero torque, beside the drives' own latency
    std::string_view bound = {};                // the same in words
    From from = From::harm;
    double lasts_s = 1;          // how long it is watched
    double deviation_m = 0.1;    // from where the robot would be without the fault, while it is watched
    bool unreachable = false;    // the firmware cannot reach the drives: their watchdogs must do it
    bool ends_firmware = false;  // no recovery
};

std::span<const TortureKind> torture_kinds();
const TortureKind* find_torture_kind(std::string_view name);

}  // namespace wheelwright::tools
