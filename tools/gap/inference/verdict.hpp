// The verdict, and nothing else that is decided of a whole log: from what the stages found, by one Policy.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tools/gap/inference/named_effect.hpp"
#include "tools/gap/inference/policy.hpp"
#include "tools/gap/inference/structures.hpp"

namespace wheelwright::gap {

enum class Verdict { named, nothing_missing, cannot_tell, unexplained, unusable_log };
const char* verdict_name(Verdict verdict);

struct Conclusion {
    Verdict verdict = Verdict::unexplained;
    std::string reason;  // one sentence
};

// What a search found missing, and what it leaves beside what it named, as shares of the torque.
struct Gaps {
    double closable = 0, residual = 0;
    double beyond_noise = 0;           // left, whether anything smooth explains it or not
    double of_interest = kPolicy.gap;  // more for what is known of a sensor only roughly
};
Conclusion conclude(std::span<const NamedEffect> effects, const Gaps& gaps, const Policy& policy = kPolicy);

// What depends on places beside what was named. `explained`, of the torque, by what was named; `roughly`:
// more than the share given, for what is known of a sensor only so well.
struct Remainder {
    std::span<const Structure> structures;
    double explained = 0;
    std::optional<double> roughly;
};
// Sure, and large enough.
bool of_interest(const Structure& structure, const Remainder& beside, const Policy& policy = kPolicy);
// The conclusion of a search, as the remainder leaves it.
Conclusion conclude(const Conclusion& search, bool named, const Remainder& remainder,
                    const Policy& policy = kPolicy);

// What no search has to find.
struct SensorGrounds {
    bool slip = false;     // of a rolling tyre
    bool effects = false;  // that a sensor shows directly
    // that a sensor shows and that are known not to be there: what shows instead, the last one first
    std::vector<std::string> denied;
};
Conclusion conclude(const Conclusion& search, const SensorGrounds& sensors);

}  // namespace wheelwright::gap
