// Fits of K5..K8 and effects on the blocks' products (rows.hpp):
// Gauss-Newton in the parameters
//   K5, K6, K7, K8, amounts p_1 ... p_m,
// with the coefficients  product: K5 | K6,  torque: K7 | K8,  column j of
// amount i: K7 p_i | K8 p_i. A fit costs some fifty thousand operations, whatever the log's length; errors
// cost several times that.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "tools/gap/model/directions.hpp"

namespace wheelwright::gap {

using Blocks = std::vector<const Block*>;

struct Fit {
    ModelShape shape;
    Eigen::VectorXd value;       // K5, K6, K7, K8, amounts
    Eigen::MatrixXd covariance;  // of blocks: robust against what the noise model leaves out
    // How many blocks tell of each value, those that tell little counting less; where the covariance is
    // `known`.
    Eigen::VectorXd telling;
    double squares = 0;  // of the whitened residual, over the blocks it was fitted to
    double rows = 0;

    double error(Eigen::Index i) const { return std::sqrt(std::max(0.0, covariance(i, i))); }
};

// Which covariance is wanted. `known` is set right for leverage and takes as long as the rest; `plain`, the
// sandwich of the blocks' scores as they are, is for tests of whether something is there at all, in which a
// block that alone shows it must not be held against it; `left_out` is none.
enum class Spread { known, plain, none };
Fit fit(const Blocks& blocks, const ModelShape& shape, Spread spread = Spread::known);

// Sum of the squared whitened residual on other blocks.
double squares(const Blocks& blocks, const Fit& fit);
double squares(const Block& block, const Fit& fit);
double row_count(const Blocks& blocks, const ModelShape& shape);

// Sum of the squared difference of the whitened rows that two fits predict.
double squares_apart(const Block& block, const Fit& a, const Fit& b);

// What the torque alone does, in the same measure: to give shares.
double torque_squares(const Blocks& blocks, const Fit& fit);

// What a fit leaves beyond the sensors' noise.
struct BeyondNoise {
    std::vector<double> squares;  // of each block's whitened rows, less what the noise makes of them
    double torque_squares = 0;    // what the torque alone does, of all

    double share_of_torque() const;  // RMS over RMS
};
BeyondNoise beyond_noise(const Blocks& blocks, const Fit& fit);

// Squared whitened residual, cross-validated over the blocks, of free
// coefficients for `columns` beside the base in each equation: what could be
// reached at best.
double reachable_squares(const Blocks& blocks, const ModelShape& shape, const std::vector<int>& columns);

// Blocks are left out of a fit in turn, every so many at once.
inline constexpr std::size_t kFolds = 5;

// Of what is known of K7 and of K8, the largest share that one of these tells.
std::array<double, kEquations> largest_fold_shares(const Blocks& blocks, const Fit& fit);

// By block, how much of its whitened squares free coefficients for `columns` in each equation explain beside
// a model that may move with them, fitted to the other blocks.
std::vector<double> gain_beside(const Blocks& blocks, const Fit& model, const std::vector<int>& columns);

// Share of what column `wanted` adds to the model that the model's other
// columns with `rival` can stand for.
double likeness(const Blocks& blocks, const Fit& base, const std::vector<Amount>& wanted,
                const std::vector<Amount>& rival);

// How far the torque may be logged late or early. More would be an effect, and on a ramp of torque, or where
// speeds were smoothed, it looks like friction and takes the gains with it.
inline constexpr double kTimingRange_samples = 0.1;

}  // namespace wheelwright::gap
