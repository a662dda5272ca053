// The rows of the paper that need neither a bus nor a controller: the estimator on models that are not a
// robot's, the plant against its equations, the linearisation against the plant. Each experiment is a
// function; the same arguments give the same numbers.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace wheelwright::paper {

// Eq (1)-(35): an ARX model of known coefficients driven by a random binary input, with equation noise of
// deviation 0.05, identified recursively and by batch (Eigen QR on the same rows).
struct ArxResult {
    std::vector<double> truth;      // a_1 .. a_p, b_1 .. b_q
    std::vector<double> recursive;  // with noise
    std::vector<double> standard_error;
    double noise_free_error = 0;  // largest error of a coefficient without noise
    double batch_difference = 0;  // recursive against batch, with noise: largest relative to the coefficient
};
ArxResult run_arx_2_2(std::size_t samples);
ArxResult run_arx_4_3(std::size_t samples);

// Single precision, P(-1) = 1e6 I, on the K5/K7 rows of Table 1's experiment: ours (factorised) and the
// textbook's update (31), each against the batch solution of the same rows. Largest relative error of K5, K7.
struct PrecisionResult {
    double factorised = 0;
    double textbook = 0;
    std::size_t textbook_negative_after = 0;  // samples until P is no longer positive; 0: never
};
PrecisionResult run_precision(std::size_t samples);

// Eq (36)-(43): the simulated robot under torques against Runge-Kutta integration of the equations as
// printed, in v and omega; largest differences over `duration_s`.
struct CascadeResult {
    double v_m_per_s = 0;
    double omega_rad_per_s = 0;
    double position_m = 0;
    double heading_rad = 0;
    double path_m = 0;  // length driven
};
CascadeResult run_cascade(double duration_s);

// Eq (61)-(64): accelerations that the plant shows against those that were asked for, at random states and
// with friction that the model knows. Largest relative error.
double run_linearisation(std::size_t states);

// Sect 1, "any robot that is linear in its parameters": a pendulum arm, J q'' = tau - m g l sin q - d q',
// identified by the same estimator.
struct ArmResult {
    std::array<double, 3> truth{};  // 1/J, m g l / J, d / J
    std::array<double, 3> estimate{};
    double largest_relative_error = 0;
};
ArmResult run_arm(double duration_s);

}  // namespace wheelwright::paper
