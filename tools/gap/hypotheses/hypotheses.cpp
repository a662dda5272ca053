#include "tools/gap/hypotheses/hypotheses.hpp"

#include "tools/gap/hypotheses/actuator_lag.hpp"
#include "tools/gap/hypotheses/back_emf_limit.hpp"
#include "tools/gap/hypotheses/backlash.hpp"
#include "tools/gap/hypotheses/castor_drag.hpp"
#include "tools/gap/hypotheses/cog_lateral.hpp"
#include "tools/gap/hypotheses/coulomb_friction.hpp"
#include "tools/gap/hypotheses/dead_zone.hpp"
#include "tools/gap/hypotheses/gain_drift.hpp"
#include "tools/gap/hypotheses/measurement_lag.hpp"
#include "tools/gap/hypotheses/payload_step.hpp"
#include "tools/gap/hypotheses/slope.hpp"
#include "tools/gap/hypotheses/stribeck_friction.hpp"
#include "tools/gap/hypotheses/torque_ripple.hpp"
#include "tools/gap/hypotheses/torque_saturation.hpp"
#include "tools/gap/hypotheses/transport_delay.hpp"
#include "tools/gap/hypotheses/viscous_friction.hpp"
#include "tools/gap/hypotheses/wheel_radius_mismatch.hpp"
#include "tools/gap/hypotheses/wheel_slip.hpp"

namespace wheelwright::gap {
namespace {

template <typename Effect>
constexpr Hypothesis make_hypothesis() {
    using Of = HypothesisOf<Effect>;
    constexpr bool kHasStart = requires { &Of::starting_points; };
    constexpr bool kHasColumns = !std::is_void_v<typename Of::Columns>;
    static_assert(kHasColumns == kHasStart, "an effect that is not linear is tried at points");
    Hypothesis h;
    if constexpr (kHasColumns) {
        h.columns = [](const Parameters<double>& p, const Setting& setting) -> std::unique_ptr<Contribution> {
            return std::make_unique<typename Of::Columns>(p, setting);
        };
        h.by_dynamics = Of::Columns::kByDynamics;
        h.starting_points = &Of::starting_points;
    } else {
        h.by_dynamics = model::ColumnsByDynamics<Effect>;
        h.starting_points = [](const Setting&) { return StartingPoints{}; };
    }
    h.in_every_drive_train = Of::kInEveryDriveTrain;
    h.late = Of::kLate;
    h.dry = model::Dry<Effect>;
    h.special_case_of = model::find_effect(Of::kSpecialCaseOf);
    h.unless_measured = Of::kUnlessMeasured;
    h.event = Of::kEvent;
    h.uncertainty = &Of::uncertainty;
    return h;
}

constexpr std::array kHypotheses =
    model::for_catalogue([]<typename Effect>() { return make_hypothesis<Effect>(); });

constexpr std::size_t kUsualCount = std::size_t(std::count_if(
    kHypotheses.begin(), kHypotheses.end(), [](const Hypothesis& h) { return h.in_every_drive_train; }));
constexpr std::array<std::size_t, kUsualCount> kUsual = [] {
    std::array<std::size_t, kUsualCount> all{};
    std::size_t n = 0;
    for (std::size_t i = 0; i < kHypotheses.size(); ++i) {
        if (kHypotheses[i].in_every_drive_train) all[n++] = i;
    }
    return all;
}();

}  // namespace

const Hypothesis& hypothesis_of(std::size_t effect) { return kHypotheses[effect]; }

std::span<const std::size_t> usual_friction() { return kUsual; }

bool is_usual_friction(std::size_t effect) {
    return std::any_of(kUsual.begin(), kUsual.end(), [&](std::size_t friction) {
        return friction == effect || hypothesis_of(friction).special_case_of == effect;
    });
}

}  // namespace wheelwright::gap
