// A sample of the fault campaign, small enough to run every time, and the judge judged.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "tools/cli/scratch_folder.hpp"
#include "tools/replay/cycle_replay.hpp"
#include "tools/torture/campaign.hpp"
#include "tools/torture/healthy.hpp"
#include "tools/torture/hostile.hpp"
#include "tools/torture/kill_saves.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

namespace {

// Read before main(), for CppUTest counts what is allocated in a test and kept.
const SceneSetup kFirst = scene_setup(1, TorturedRobots::standard);

// What does not hold yet: a run that breaks each rule. When one of them begins to hold, the test says so, and
// its line goes.
struct Known {
    const char* kind;
    std::uint64_t seed;
    const char* rule;
};
constexpr Known kKnown[] = {
    // clang-format off
    {"lie_sign", 611030, "late"},
    {"lie_frozen", 641235, "late"},
    {"lie_both_frozen", 641030, "late"},
    {"lie_half_counts", 611238, "quicker"},
    {"lie_half_speed", 641186, "quicker"},
    {"long_delay", 651235, "name"},
    {"origin_jump", 561189, "false trip"},
    // clang-format on
};

std::string all_of(const std::vector<std::string>& lines) {
    std::string text;
    for (const std::string& line : lines) text += line + "\n";
    return text;
}

TortureResult tortured(const TortureKind& kind, std::uint64_t seed) {
    return torture(kind, untouched_drive(seed, TorturedRobots::both));
}

}  // namespace

TEST_GROUP(Torture){};

// Forty seeds are each mode on both layouts, both generations, and the default and a drawn robot; each third
// kind with each of them.
TEST(Torture, every_fault_is_survived_or_ends_in_time_and_under_its_name) {
    std::size_t runs = 0;
    std::string broken;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
        const UntouchedDrive untouched = untouched_drive(seed, TorturedRobots::both);
        CHECK_EQUAL_TEXT(std::string(), untouched.problem, untouched.setup.text().c_str());
        std::size_t number = seed;
        for (const TortureKind& kind : torture_kinds()) {
            if (++number % 3 != 0) continue;
            ++runs;
            const TortureResult result = torture(kind, untouched);
            for (const std::string& violation : result.violations)
                broken += std::string(kind.name) + ", seed " + std::to_string(seed) + ": " + violation + "\n";
        }
    }
    std::printf("  %zu runs\n", runs);
    CHECK_TEXT(broken.empty(), broken.c_str());
}

// The kinds that a firmware which reckons with a report in each cycle does not survive. Reports that are
// asked for between two, samples that come late, a drive that is back: with each mode.
TEST(Torture, encoders_that_report_seldom_are_no_other_faults) {
    std::string broken;
    for (const int report_ms : {2, 5, 10}) {
        for (std::uint64_t seed = 1; seed <= 5; ++seed) {
            const UntouchedDrive untouched = untouched_drive(seed, TorturedRobots::both, report_ms);
            CHECK_EQUAL_TEXT(std::string(), untouched.problem, untouched.setup.text().c_str());
            for (const char* name : {"extended_and_remote", "long_delay", "drive_reboots_armed", "bus_jam",
                                     "no_encoder_frames", "loss_1_percent", "stop_line"}) {
                const TortureKind* kind = find_torture_kind(name);
                CHECK_TEXT(kind != nullptr, name);
                const TortureResult result = torture(*kind, untouched);
                for (const std::string& violation : result.violations)
                    broken += std::string(name) + ", seed " + std::to_string(seed) + ", " +
                              std::to_string(report_ms) + " ms: " + violation + "\n";
            }
        }
    }
    CHECK_TEXT(broken.empty(), broken.c_str());
}

TEST(Torture, what_is_known_not_to_hold_does_not_hold_yet) {
    for (const Known& known : kKnown) {
        const TortureKind* kind = find_torture_kind(known.kind);
        CHECK_TEXT(kind != nullptr, known.kind);
        const TortureResult result = tortured(*kind, known.seed);
        const bool breaks = std::any_of(result.violations.begin(), result.violations.end(),
                                        [&](const std::string& violation) {
                                            return violation.starts_with(std::string(known.rule) + ":");
                                        });
        CHECK_TEXT(breaks,
                   (std::string(known.kind) + " begins to hold with seed " + std::to_string(known.seed) +
                    ": run the campaign, then take its line away; now: " + all_of(result.violations))
                       .c_str());
    }
}

// Encoders that stand: behind a drive's loop that goes on within a count, under a torque that a slope might
// hold, and from a probe's last push on.
TEST(Torture, what_once_broke_a_rule_holds) {
    for (const auto& [name, seed] :
         {std::pair{"lie_frozen", 681062}, {"lie_frozen", 651034}, {"lie_both_frozen", 661215}}) {
        const TortureKind* kind = find_torture_kind(name);
        CHECK_TEXT(kind != nullptr, name);
        const TortureResult result = tortured(*kind, static_cast<std::uint64_t>(seed));
        CHECK_TEXT(result.violations.empty(), all_of(result.violations).c_str());
    }
}

TEST(Torture, a_seed_gives_the_same_bytes_again) {
    for (const char* name : {"loss_20_percent", "mode_storm", "stall", "reorder"}) {
        const TortureKind& kind = *find_torture_kind(name);
        const TortureResult one = tortured(kind, 23);
        const TortureResult again = tortured(kind, 23);
        CHECK_TEXT(one.bytes == again.bytes, name);
        CHECK_TEXT(one.story == again.story, name);
        CHECK_TEXT(one.bytes != tortured(kind, 24).bytes, name);
    }
}

// Each run that breaks a rule can be replayed by its seed.
TEST(Torture, a_campaign_names_the_seeds_that_break_a_rule) {
    const TortureKind& kind = torture_kinds().front();
    std::vector<TortureResult> results(30);
    for (std::size_t i = 0; i < results.size(); ++i) {
        results[i].kind = kind.name;
        results[i].seed = 101 + i;
        results[i].setup = "pose, one bus";
        if (i % 2 == 1) results[i].violations = {"late: by 2 ms"};
    }
    const KindSummary few = summaries({&kind}, {results.begin(), results.begin() + 7}).front();
    CHECK_EQUAL(3U, few.violated);
    STRCMP_EQUAL("3 runs (pose 3), first seed 102 (pose, one bus) late: by 2 ms, then 104 106",
                 few.examples.front().c_str());
    for (TortureResult& result : results) result.violations = {"late: by 2 ms"};
    const std::string many = summaries({&kind}, results).front().examples.front();
    STRCMP_CONTAINS(" 120 ...", many.c_str());
}

TEST(Torture, there_are_forty_kinds_and_no_two_of_one_name) {
    CHECK(torture_kinds().size() >= 40);
    for (const TortureKind& kind : torture_kinds()) {
        CHECK_TEXT(find_torture_kind(kind.name) == &kind, std::string(kind.name).c_str());
        CHECK_TEXT(kind.expect != Expect::stops || kind.bound_s != nullptr, std::string(kind.name).c_str());
    }
    CHECK(find_torture_kind("no such kind") == nullptr);
}

// Rows that expect what does not happen: the judge must see each.
TEST_GROUP(TortureJudge){
    static void sees(const TortureKind& kind, const std::string& rule,
                     std::uint64_t seed = 1){const TortureResult result = tortured(kind, seed);
const bool seen =
    std::any_of(result.violations.begin(), result.violations.end(),
                [&](const std::string& violation) { return violation.starts_with(rule + ":"); });
CHECK_TEXT(seen, (rule + " is not seen; but " + all_of(result.violations)).c_str());
}
static TortureKind like(const char* name) { return *find_torture_kind(name); }
}
;

TEST(TortureJudge, a_stop_where_service_is_asked_for) {
    TortureKind kind = like("stop_line");
    kind.expect = Expect::serves;
    kind.names = "";
    sees(kind, "false trip");
}

TEST(TortureJudge, a_wrong_name) {
    TortureKind kind = like("stop_line");
    kind.names = "over_speed,stale_command";
    sees(kind, "name");
}

TEST(TortureJudge, a_stop_that_comes_too_late) {
    TortureKind kind = like("no_heartbeats");
    kind.bound_s = [](const Scene&) { return 0.05; };
    sees(kind, "late");
}

TEST(TortureJudge, a_fault_that_nobody_notices) {
    TortureKind kind = like("no_torque_reports");
    kind.expect = Expect::stops;
    kind.bound_s = [](const Scene&) { return 0.1; };
    sees(kind, "goes on");
    sees(kind, "late");
}

TEST(TortureJudge, torque_that_somebody_gives_a_robot_at_rest) {
    TortureKind kind = like("foreign_arming_flood");
    kind.each = [](Scene& s) {
        for (int i = 0; i < 4; ++i) like("foreign_arming_flood").each(s);
    };
    sees(kind, "torque at rest");
}

TEST(TortureJudge, a_robot_that_is_pushed_off_its_way_or_pushed_quicker) {
    TortureKind kind = like("save_while_driving");
    kind.each = [](Scene& s) { s.sim().world().plant().set_disturbance({5, 0}); };
    kind.deviation_m = 0.001;
    sees(kind, "off its way");
    kind.each = [](Scene& s) { s.sim().world().plant().set_disturbance({200, 0}); };
    sees(kind, "quicker");
}

// Torque on a robot beyond the limits; one that coasts is nobody's.
TEST(TortureJudge, a_robot_that_is_driven_too_fast) { sees(like("lie_half_counts"), "too fast", 71); }

TEST(TortureJudge, a_robot_that_never_drives_again) {
    TortureKind kind = like("drive_error");
    kind.inject = [](Scene& s) {
        s.drive().raise_error(0x10);
        s.undo = [&s] { s.sim().bus().set_down(1, true); };
    };
    sees(kind, "no way out");
}

TEST_GROUP(HostileFrames){};

TEST(HostileFrames, a_robot_goes_on_whatever_is_on_its_bus) {
    for (const HostilePlan plan : {HostilePlan::idle_harmless, HostilePlan::driving_harmless}) {
        for (std::uint64_t seed = 1; seed <= 4; ++seed) {
            const HostileResult result = be_hostile(plan, seed, 25'000);
            CHECK_TEXT(result.violations.empty(), (result.setup + ": " + all_of(result.violations)).c_str());
            CHECK_TEXT(result.faults.empty() || result.valid_commands > 0, result.setup.c_str());
        }
    }
}

TEST(HostileFrames, frames_for_the_drives_and_stops_end_in_the_stated_faults) {
    for (const HostilePlan plan : {HostilePlan::idle_all, HostilePlan::driving_all}) {
        for (std::uint64_t seed = 1; seed <= 4; ++seed) {
            const HostileResult result = be_hostile(plan, seed, 15'000);
            CHECK_TEXT(result.broken.empty(), (result.setup + ": " + all_of(result.violations)).c_str());
            CHECK(!result.faults.empty());
        }
    }
}

TEST(HostileFrames, memory_stays_as_it_is) {
    be_hostile(HostilePlan::driving_all, 1, 5'000);
    const std::uint64_t before = resident_bytes();
    be_hostile(HostilePlan::driving_all, 1, 20'000);
    CHECK(before > 0);
    CHECK(resident_bytes() <= before + (std::uint64_t{1} << 20U));
}

TEST_GROUP(HealthyDriving){};

TEST(HealthyDriving, nothing_trips_with_one_frame_of_a_thousand_lost) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        const HealthyResult result = drive_healthy(seed, 90);
        CHECK_TEXT(result.trips.empty(), (result.robot + ": " + all_of(result.trips)).c_str());
        CHECK_TEXT(result.fastest > 0.3 && result.strays.empty(), result.strays.c_str());
        CHECK(result.drives > 2);
    }
}

TEST(HealthyDriving, slopes_bumps_obstacles_and_tyres_that_slip_are_no_faults) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        const HealthyResult result = drive_healthy(seed, 45, true);
        CHECK_TEXT(result.trips.empty(), (result.robot + ": " + all_of(result.trips)).c_str());
        CHECK(result.drives > 2);
    }
}

// It turns about one wheel, which the centre of gravity ahead of the axle holds against full torque.
TEST(HealthyDriving, a_wheel_that_the_turning_body_holds_is_no_frozen_encoder) {
    const HealthyResult result = drive_healthy(14, 480);
    CHECK_TEXT(result.trips.empty(), all_of(result.trips).c_str());
}

// Its torque is short, and turning pushes it towards a centre of gravity two fifths of the track ahead: it
// was driven to 1.26 times its speed limit.
TEST(HealthyDriving, a_turn_pushes_no_robot_past_its_limits) {
    const HealthyResult result = drive_healthy(944141448, 1200);
    CHECK_TEXT(result.trips.empty(), all_of(result.trips).c_str());
    CHECK_TEXT(result.strays.empty(), result.strays.c_str());
}

// An identification leaves both asymmetries beside the estimators' four columns, and a robot file may hold
// more.
TEST(HealthyDriving, telemetry_has_room_for_every_effect) {
    std::size_t parameters = 0;
    for (const model::EffectInfo& effect : model::kEffects) parameters += effect.parameters.size();
    CHECK(task::CycleReport{}.effects.size() >= parameters);
}

TEST_GROUP(KilledSaves){};

TEST(KilledSaves, the_robot_file_is_the_old_or_the_new_one) {
    namespace fs = std::filesystem;
    const fs::path folder = fs::temp_directory_path() / ("wheelwright-kills-" + std::to_string(::getpid()));
    fs::create_directories(folder);
    const std::string path = (folder / "robot.toml").string();
    fs::copy_file(WHEELWRIGHT_ROBOTS "/default.toml", path);
    const KillSavesResult result = kill_saves(path, 60, 1);
    fs::remove_all(folder);
    CHECK_EQUAL_TEXT(std::string(), result.problem, result.problem.c_str());
    CHECK_EQUAL(60U, result.kills);
    CHECK_EQUAL(0U, result.broken);
    CHECK(result.saves_seen >= 30);  // or nothing was saved that could break
}

// Frames lost, late, wrong and refused, jams, stalls, reboots, second hosts: whatever the cycle was told is
// in its black box. WHEELWRIGHT_CAMPAIGN: every kind.
TEST_GROUP(TortureBlackBox){};

TEST(TortureBlackBox, what_went_wrong_runs_again_to_the_same_bytes) {
    const char* all = std::getenv("WHEELWRIGHT_CAMPAIGN");
    const std::size_t stride = all != nullptr && *all != '\0' ? 1 : 9;
    std::size_t boxes = 0;
    for (std::size_t i = 0; i < torture_kinds().size(); i += stride) {
        const TortureKind& kind = torture_kinds()[i];
        const UntouchedDrive untouched = untouched_drive(i + 1, TorturedRobots::both);
        const ScratchFolder folder;
        torture(kind, untouched, {"", folder.path()});
        for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
            std::ifstream in(entry.path());
            task::BlackBoxFile file;
            const std::string problem = task::read_black_box(in, file);
            const ReplayResult result = problem.empty() ? replay(file) : ReplayResult{};
            const std::string what = std::string(kind.name) + ", seed " + std::to_string(i + 1) + ": " +
                                     problem + result.problem +
                                     (result.difference ? result.difference->what : "");
            CHECK_TEXT(problem.empty() && result.problem.empty() && !result.difference, what.c_str());
            CHECK(file.as_written);
            ++boxes;
        }
    }
    std::printf("%zu black boxes\n", boxes);
    CHECK(boxes >= torture_kinds().size() / stride / 2);
}
