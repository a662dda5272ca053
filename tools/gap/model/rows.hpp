// From measured logs to sums of squares and products, block by block:
// everything that the search for a missing effect works on afterwards.
//
// Over one sample interval of length dt a speed changes by exactly dt times the
// mean of its acceleration, so with s_n = sin(k pi (n + 1/2) / N) over a block
// of N intervals, k = 1, 2, ...
//     sum_n s_n (v_{n+1} - v_n)  =  dt sum_n s_n mean_n( K5 omega^2 + K7 (tau_R
//     + tau_L) + ... )
// without a derivative being taken. White noise of variance sigma^2 in the
// speeds gives the left side the variance 2 N sin^2(k pi / 2N) sigma^2 and
// makes the rows for different k uncorrelated (the left side is a cosine
// transform), so dividing by its root makes the rows white. Torque is held from
// each sample to the next.
//
// Columns are accelerations over K7 in the linear equation and over K8 in the
// turning one: a torque's sum and difference. One effect is one group of
// columns with the same coefficients in both.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "firmware/model/dynamics.hpp"
#include "tools/gap/logs/experiment.hpp"
#include "tools/gap/model/columns.hpp"

namespace wheelwright::gap {

enum Equation : std::size_t { kLinear, kTurning, kEquations };

struct Block {
    std::array<int, kEquations> rows{};
    double first_Hz = 0;                          // frequency of the first row; the others are its multiples
    std::array<Eigen::MatrixXd, kEquations> row;  // [columns | y], white where only the sensor is noisy
    std::array<Eigen::MatrixXd, kEquations> product;  // of the rows, weighted
};

// Power of what no model explains over that of the sensor's white noise, by frequency. Noise of the
// accelerations changes the speed over an interval, so that it grows as the square of the frequency's
// inverse, and at `corner_Hz` is what the sensor's is; below `slowest_Hz` it grows no more: a speed that was
// smoothed, or a load that comes back, errs no more over a longer time.
struct Colour {
    std::array<double, kEquations> level{1, 1}, corner_Hz{}, slowest_Hz{};

    double power(std::size_t equation, double frequency_Hz) const {
        const double corner = corner_Hz[equation];
        const double slowest = slowest_Hz[equation];
        return level[equation] * (1 + corner * corner / (frequency_Hz * frequency_Hz + slowest * slowest));
    }
};

// Half of a transform of a block's intervals (rows) to its equations (columns): a sine is even or odd about
// the block's middle, of odd k and of even k.
struct Sines {
    Eigen::MatrixXd odd, even;
};

// What blocks of the same parts, made with the same options but for the dictionary, have in common: columns
// of the same source. make_blocks() takes from it what it has and puts there what it had to make; that the
// parts are the same is not checked.
struct KeptColumns {
    struct Piece {
        std::array<Eigen::MatrixXd, kEquations> row;  // of a block, a column for each source
        Eigen::MatrixXd wheels;                       // a row for each: wheel torques, of both wheels in turn
    };
    std::vector<Source> source;
    std::vector<Piece> pieces;
    std::map<std::pair<int, int>, Sines> sines;  // by intervals and equations
};

struct BlockOptions {
    const Dictionary* dictionary = nullptr;  // its setting's dynamics are refined by the caller
    KeptColumns* kept = nullptr;             // null: nothing is
    double block_s = 2;
    WheelPair<double> noise_rad_per_s;
    double speed_rms_rad_per_s = 0;  // of the wheels, over the whole experiment
    // The torques do not turn the robot: what its wheels differ by is noise, and columns are made of their
    // mean.
    bool straight = false;
};

struct BlockSet {
    std::vector<Block> blocks;
    Eigen::MatrixXd wheel_power;  // mean over samples of column_i . column_j,
                                  // as wheel torques, both wheels
    double torque_rms_Nm = 0;     // of both wheels together
};

// The likeliest colour of the rest that columns together leave, equation by equation: of those among these
// sets that explain most for their number (Schwarz's criterion).
Colour colour_of_rest(const BlockSet& set, std::span<const std::vector<int>> columns);

// The products anew, each row over the root of the colour's power.
void weigh(BlockSet& set, const Colour& colour);

// The products anew, of those rows alone at whose frequencies the speeds move more than their noise does, by
// block and by thirds of a decade. A drive's speed loop turns the noise that it measures into torque: where
// there is no other torque, as that of driving in a spin, it looks like torque that comes late.
void weigh_where_motion_is_seen(BlockSet& set, const Colour& colour);

BlockSet make_blocks(std::span<const LogPart> parts, const BlockOptions& options);

// Two dozens of blocks where the parts allow it. The dictionary is left to be set.
BlockOptions block_options(std::span<const LogPart> parts, const WheelPair<double>& noise_rad_per_s,
                           double speed_rms_rad_per_s);

struct WeighedBlocks {
    BlockSet set;
    Colour colour;  // that the dictionary's columns leave without those of `excluded` effects
};
WeighedBlocks weighed_blocks(std::span<const LogPart> parts, const BlockOptions& options,
                             std::span<const std::size_t> excluded);

// They point into `set`.
std::vector<const Block*> pointers(const BlockSet& set);

}  // namespace wheelwright::gap
