// "The same four parameters of the notes' robot identified by the firmware over CAN at 1 kHz, with default
// encoder, noise, latency and Coulomb friction 0.3 Nm: within 2 %, with the same honesty of intervals."
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/chain/robots.hpp"
//
#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::tools;

TEST_GROUP(ChainIdentification){};

TEST(ChainIdentification, all_four_within_two_percent_and_intervals_that_hold) {
    const int seeds = chain::seeds(30, 200);
    const model::Dynamics<double> truth = chain::truth();
    const std::array<double, 4> real{truth.k5_m, truth.k6_per_m, truth.k7_per_kg_m, truth.k8_per_kg_m2};
    std::array<double, 4> z_sum{};
    std::array<double, 4> z_square{};
    std::array<double, 4> worst{};
    std::array<int, 4> covered{};
    std::array<double, 4> square{};
    std::vector<double> times_s;
    double longest_s = 0;
    double farthest_m = 0;
    for (int seed = 1; seed <= seeds; ++seed) {
        Simulation sim(chain::believed().parameters, chain::real().parameters,
                       chain::options(static_cast<std::uint64_t>(seed)));
        sim.run_for(0.5);
        const IdentificationResult result = identify(sim);
        CHECK(result.succeeded);
        const auto& k = result.estimate.dynamics;
        const auto& e = result.estimate.standard_error;
        const std::array<double, 4> value{k.k5_m, k.k6_per_m, k.k7_per_kg_m, k.k8_per_kg_m2};
        const std::array<double, 4> error{e.k5_m, e.k6_per_m, e.k7_per_kg_m, e.k8_per_kg_m2};
        for (std::size_t i = 0; i < 4; ++i) {
            const double z = (value[i] - real[i]) / error[i];
            z_sum[i] += z;
            z_square[i] += z * z;
            if (std::abs(z) <= 1.96) ++covered[i];
            const double error_share = value[i] / real[i] - 1;
            square[i] += error_share * error_share;
            worst[i] = std::max(worst[i], std::abs(error_share));
        }
        times_s.push_back(result.duration_s);
        longest_s = std::max(longest_s, result.duration_s);
        farthest_m = std::max(farthest_m, result.farthest_m);
    }
    std::sort(times_s.begin(), times_s.end());
    std::printf(
        "%d seeds, half of them at most %.1f s of driving, all at most %.0f s, %.2f m from the start\n",
        seeds, times_s[times_s.size() / 2], longest_s, farthest_m);
    for (std::size_t i = 0; i < 4; ++i) {
        const double n = seeds;
        const double coverage = covered[i] / n;
        std::printf(
            "K%zu: worst error %.3f %%, rms %.3f %%, mean z %+.2f, rms z %.2f, 95 %% interval covers %.0f "
            "%%\n",
            i + 5, 100 * worst[i], 100 * std::sqrt(square[i] / n), z_sum[i] / n, std::sqrt(z_square[i] / n),
            100 * coverage);
    }
    for (std::size_t i = 0; i < 4; ++i) {
        const double n = seeds;
        const double coverage = covered[i] / n;
        CHECK(worst[i] < 0.02);
        // The demand is made of the 200 seeds; 30 are given three standard errors of their own statistics.
        // K7's and K8's errors hold an allowance for what a model may lack, and this robot's lacks little:
        // they may be 1.4 times as large as its errors are. On strangers' robots they fit (docs/measured.md).
        const bool all = seeds >= 200;
        const double mean = z_sum[i] / n;
        const double rms = std::sqrt(z_square[i] / n);
        CHECK(std::abs(mean) < (all ? 0.3 : 0.1 + 3 / std::sqrt(n)));
        CHECK(rms > (all ? 0.7 : 0.5));
        CHECK(rms < (all ? 1.25 : 1.05 + 3 / std::sqrt(2 * n)));
        CHECK(coverage > (all ? 0.88 : 0.94 - 3 * std::sqrt(0.95 * 0.05 / n)));
    }
    CHECK(farthest_m < chain::believed().parameters.ident.distance_limit_m);
}

TEST(ChainIdentification, friction_that_the_file_does_not_list_is_found_and_compensated_all_the_same) {
    model::RobotParameters silent = chain::believed().parameters;
    silent.effects = {};
    Simulation sim(silent, chain::real().parameters, chain::options(5));
    sim.run_for(0.5);
    const IdentificationResult result = identify(sim);
    CHECK(result.succeeded);
    CHECK(std::abs(result.estimate.dynamics.k7_per_kg_m / chain::truth().k7_per_kg_m - 1) < 0.005);
    CHECK(std::abs(result.estimate.dynamics.k8_per_kg_m2 / chain::truth().k8_per_kg_m2 - 1) < 0.005);
    const std::size_t dry = model::find_effect("coulomb_friction");
    CHECK(sim.parameters().effects.active[dry]);
    CHECK(sim.parameters().effects.active[model::find_effect("viscous_friction")]);
    DOUBLES_EQUAL(chain::real().parameters.effects.parameter[dry][0],
                  sim.parameters().effects.parameter[dry][0], 0.01);
}

TEST(ChainIdentification, friction_is_found_too) {
    Simulation sim(chain::believed().parameters, chain::real().parameters, chain::options(7));
    sim.run_for(0.5);
    const IdentificationResult result = identify(sim);
    CHECK(result.succeeded);
    const auto& found = result.estimate.effects;
    const auto& error = result.estimate.effects_standard_error;
    const auto& real = chain::real().parameters.effects;
    for (std::size_t i = 0; i < model::kEffectCount; ++i) {
        if (!real.active[i]) continue;
        for (std::size_t j = 0; j < model::kEffects[i].parameters.size(); ++j) {
            std::printf("%s.%s: %.4f +- %.4f, truth %.4f\n", model::kEffects[i].name.data(),
                        model::kEffects[i].parameters[j].name.data(), found.parameter[i][j],
                        error.parameter[i][j], real.parameter[i][j]);
            CHECK(std::abs(found.parameter[i][j] - real.parameter[i][j]) < 4 * error.parameter[i][j] + 0.001);
        }
    }
}

// Effects beside those that an identification estimates keep what is known of them; what the coupling of
// forward and turning shows of two of them is recorded with its error. Adaptive mode may be entered then.
TEST(ChainIdentification, what_it_does_not_estimate_it_leaves_alone) {
    const std::size_t lag = model::find_effect("actuator_lag");
    const std::size_t lateral = model::kCogLateral;
    const std::size_t gains = model::find_effect("torque_gain_mismatch");
    model::RobotParameters listed = chain::believed().parameters;
    for (const std::size_t i : {lag, lateral, gains}) listed.effects.active[i] = true;
    listed.effects.parameter[lag][0] = 0.0003;
    listed.effects_standard_error.parameter[lag][0] = 0.00004;
    Simulation sim(listed, chain::real().parameters, chain::options(8));
    sim.run_for(0.5);
    for (int run = 0; run < 2; ++run) {
        CHECK(identify(sim).succeeded);
        DOUBLES_EQUAL(0.0003, sim.parameters().effects.parameter[lag][0], 1e-9);
        DOUBLES_EQUAL(0.00004, sim.parameters().effects_standard_error.parameter[lag][0], 1e-9);
        for (const std::size_t i : {lateral, gains})
            CHECK(sim.parameters().effects_standard_error.parameter[i][0] > 0);
    }
    sim.host().velocity({});
    CHECK(enter_mode(sim, protocol::Mode::adaptive));
}
