// A model's equations in as few unknowns as they have. Columns that share a coefficient are one direction:
//   the product of speeds, the torque, each amount's columns, those whose amount is one, what was measured,
// and whatever else is wanted. The products of a block's columns, summed by direction, are all that a fit
// needs of it: a dozen rows instead of a hundred.
//
// In these the row of an equation is  c = (product, gain, gain a_1 ... gain a_n, gain, -1, 0 ...)  with K5
// and K7, or K6 and K8, and the amounts a: linear in each of them, so that first and second derivatives of
// its square are a few products of r with c and with dc/dgain.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "tools/gap/model/rows.hpp"

namespace wheelwright::gap {

struct ModelShape {
    std::vector<Amount> amounts;
    std::vector<int> fixed;                                     // columns whose amount is one
    bool turning = true;                                        // false: the turning equation is left out
    std::array<std::optional<double>, kEquations> held_gain{};  // of K7 and K8; none: fitted

    std::size_t equations() const { return turning ? kEquations : kTurning; }
};

// Where the parameters of a model stand: K5, K6, K7, K8, amounts.
inline constexpr Eigen::Index kFirstAmount = 4;
inline constexpr Eigen::Index product_of(std::size_t equation) { return Eigen::Index(equation); }
inline constexpr Eigen::Index gain_of(std::size_t equation) { return 2 + Eigen::Index(equation); }

// Columns with a coefficient each.
struct Combination {
    std::vector<Eigen::Index> column;
    std::vector<double> weight;

    // Sum of squares of its row. `product` is symmetric.
    double squares(const Eigen::MatrixXd& product) const;
};

class Directions {
  public:
    static constexpr Eigen::Index kProduct = 0, kTorque = 1, kAmounts = 2;

    // `y`: the column of what was measured. `more`: columns beside the model's, each its own direction.
    Directions(const ModelShape& shape, Eigen::Index y, std::span<const int> more = {});

    Eigen::Index amounts() const { return amounts_; }
    Eigen::Index fixed() const { return kAmounts + amounts_; }
    Eigen::Index y() const { return fixed() + 1; }
    Eigen::Index more() const { return y() + 1; }
    Eigen::Index size() const { return static_cast<Eigen::Index>(first_.size()) - 1; }

    // Adds products of columns, by direction, to `sum`: size() square, its lower triangle. `product` is
    // symmetric.
    void add(const Eigen::MatrixXd& product, Eigen::MatrixXd& sum) const;
    // Sum of the squares of an amount's columns, each for itself.
    double power(const Eigen::MatrixXd& product, Eigen::Index amount) const;
    // The columns with their direction's coefficient in `row`.
    Combination combination(const Eigen::VectorXd& row) const;

  private:
    void put(std::span<const int> columns);

    Eigen::Index amounts_;
    std::vector<std::size_t> first_{0};  // of each direction's columns
    std::vector<Eigen::Index> column_;
};

// Both triangles by direction: of one block, and of several together.
Eigen::MatrixXd by_direction(const Eigen::MatrixXd& product, const Directions& directions);
Eigen::MatrixXd by_direction(std::span<const Block* const> blocks, std::size_t equation,
                             const Directions& directions);

// One equation at a point of a model: move() first, and again for another point. The directions must outlive
// it. Matrices r are of size() square; a call costs a few products of one with a vector.
class Tangent {
  public:
    Tangent(const Directions& directions, std::size_t equation);

    // To parameters p: kFirstAmount and the amounts.
    void move(const Eigen::VectorXd& p);
    const Eigen::VectorXd& row() const { return row_; }  // c

    // Sum of squares of products by direction, both triangles.
    double squares(const Eigen::MatrixXd& r);
    // Adds half the second derivative, without the row's own, and half the first one's negative: normal
    // matrix and gradient of Gauss and Newton, in p's order. `normal`: lower triangle.
    void add(const Eigen::MatrixXd& r, Eigen::MatrixXd& normal, Eigen::VectorXd& gradient);
    // The same of p, and of free coefficients for the directions behind y from `at` on.
    void add_with_more(const Eigen::MatrixXd& r, Eigen::Index at, Eigen::MatrixXd& normal,
                       Eigen::VectorXd& gradient);

  private:
    const Directions& directions_;
    Eigen::Index product_, gain_at_;
    double gain_ = 0;
    Eigen::VectorXd row_, by_gain_;  // c, dc/dgain
    Eigen::VectorXd with_row_, with_gain_;
};

}  // namespace wheelwright::gap
