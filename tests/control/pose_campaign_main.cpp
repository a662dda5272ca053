// pose_campaign [goals] [seed]: pose goals in each direction mode (default: 10 000 each); exit 0 when all
// arrive.
#include <array>
#include <cstdio>
#include <cstdlib>

#include "tests/control/pose_campaign.hpp"

int main(int argc, char** argv) {
    using wheelwright::model::GoalDirection;
    const int goals = argc > 1 ? std::atoi(argv[1]) : 10'000;
    const auto seed = static_cast<std::uint64_t>(argc > 2 ? std::atoll(argv[2]) : 1);
    if (goals <= 0) {
        std::fprintf(stderr, "usage: pose_campaign [goals] [seed]\n");
        return 1;
    }
    constexpr std::array<const char*, 3> names{"forward", "reverse", "automatic"};
    bool all = true;
    std::printf(
        "direction  arrived        mean s  worst s  worst mm  worst deg  torque span Nm  step Nm  wrong way "
        "m\n");
    for (const auto direction : {GoalDirection::forward, GoalDirection::reverse, GoalDirection::automatic}) {
        const auto r = bench::run_pose_campaign(direction, goals, seed);
        std::printf("%-9s  %5d / %-5d  %6.1f  %7.1f  %8.2f  %9.3f  %14.3f  %7.4f  %11.3f\n",
                    names[static_cast<std::size_t>(direction)], r.arrived, r.goals, r.mean_s, r.slowest_s,
                    1e3 * r.worst_position_m, 57.29577951 * r.worst_heading_rad, r.worst_span_Nm,
                    r.worst_step_Nm, r.worst_wrong_way_m);
        if (r.arrived != r.goals)
            std::printf("  first failure: goal %llu\n", static_cast<unsigned long long>(r.first_failure));
        all = all && r.arrived == r.goals;
    }
    return all ? 0 : 3;
}
