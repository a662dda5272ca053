#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "tools/gap_bench/peers/peers.hpp"

namespace wheelwright::peers {
namespace {

// Slower than this counts as standing, in SysId as it was used on the corpus; a robot that is never so fast
// is taken from half its top speed on.
constexpr double kMotionThreshold_m_per_s = 0.1;

}  // namespace

OneStepLaw sysid_regression(std::span<const ForwardRun> runs, double wheel_radius_m) {
    double top = 0;
    for (const ForwardRun& run : runs) top = std::max(top, run.speed_rad_per_s.cwiseAbs().maxCoeff());
    const double threshold = std::min(kMotionThreshold_m_per_s / wheel_radius_m, top / 2);
    std::vector<Eigen::RowVector4d> rows;  // speed, sign, voltage; the next speed
    for (const ForwardRun& run : runs) {
        for (const Eigen::Index k : moving_steps(run, threshold)) {
            const double speed = run.speed_rad_per_s(k);
            rows.emplace_back(speed, speed > 0 ? 1 : -1, run.torque_Nm(k), run.speed_rad_per_s(k + 1));
        }
    }
    Eigen::MatrixXd all(static_cast<Eigen::Index>(rows.size()), 4);
    for (std::size_t i = 0; i < rows.size(); ++i) all.row(static_cast<Eigen::Index>(i)) = rows[i];
    const Eigen::Vector3d x = all.leftCols<3>().colPivHouseholderQr().solve(all.col(3));
    return {.keeps = x(0), .gain = x(2), .friction = -x(1)};
}

}  // namespace wheelwright::peers
