// The paper's experiment (Sect 5.3, Figs 10-17, Table 1): plant (60) in its own coordinates, +-5 Nm PRBS on
// each input at 100 Hz, the two regressions (50)-(55) by recursive least squares without forgetting.
//
//   u1' = K5 u2^2 + K7 (tau1 + tau2)        K5 = 0.00431   K7 =  18.7807
//   u2' = K6 u1 u2 + K8 (tau1 - tau2)       K6 = 0.18510   K8 = -14.3839
//
// What the print leaves open, and what is done here:
//   - (60) is unstable at every u1 > 0. The speed is bounded, |u1| < 3 and |u2| < 20, by overriding the
//   torque.
//   - The number of samples follows from the paper's covariance diagonal: about 10 200.
//   - The prior is theta = 0, P(-1) = 1e6 I.
//   - Noise, where asked for: white on the measured u (deviation `speed_noise`), and white torque that nobody
//     knows of on each input (`torque_noise_Nm`, constant over a sample).
// Between samples the plant is integrated by RK4 in steps of a tenth of a sample.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace wheelwright::paper {

inline constexpr std::array<double, 4> kTable1Truth{0.00431, 0.18510, 18.7807, -14.3839};  // K5, K6, K7, K8
inline constexpr std::array<double, 4> kTable1PaperCovariance{7.0428e-12, 1.0870e-9, 1.9617e-6, 1.9497e-6};
inline constexpr double kTable1Prior = 1e6;

enum class Table1Regression : std::uint8_t {
    plain,          // eq (44)-(49) as printed: regressors at the sample's start
    step_averaged,  // regressors averaged over the step, u taken as linear within it
};

struct Table1Options {
    std::uint32_t seed = 1;
    std::size_t samples = 10200;
    Table1Regression regression = Table1Regression::step_averaged;
    double speed_noise = 0;
    double torque_noise_Nm = 0;
    std::size_t series_stride = 0;  // > 0: keep every so many-th estimate for the figures
    bool keep_rows = false;         // keep the regressions' rows, for a batch solution
};

struct Table1Row {
    std::array<double, 2> phi;
    double y;
};

struct Table1Point {
    double time_s;
    std::array<double, 4> estimate;
    std::array<double, 4> covariance_diagonal;
};

// Arrays are in the order K5, K6, K7, K8.
struct Table1Result {
    std::array<double, 4> estimate{};
    std::array<double, 4> covariance_diagonal{};   // bare P_ii, as in the paper
    std::array<double, 4> standard_error{};        // with the residuals' colour
    std::array<double, 4> naive_standard_error{};  // residual variance times P_ii, for comparison
    std::array<double, 2> torque_power{};          // sum of phi^2 for K7 and K8
    std::array<double, 2> largest_speed{};         // |u1|, |u2|, true
    std::size_t overridden_samples = 0;
    std::vector<Table1Point> series;
    std::array<std::vector<Table1Row>, 2> rows;  // of y1 and y2
};

Table1Result run_table1(const Table1Options& options);

}  // namespace wheelwright::paper
