// A model's equations in the directions of its columns.
#include "tools/gap/model/directions.hpp"

#include <CppUTest/TestHarness.h>

#include <random>

using namespace wheelwright;

namespace {

constexpr Eigen::Index kColumns = 12;  // the last was measured

Eigen::MatrixXd random_rows(unsigned seed) {
    std::mt19937 engine(seed);
    std::normal_distribution<double> normal;
    return Eigen::MatrixXd::NullaryExpr(40, kColumns, [&] { return normal(engine); });
}

// A timing, left and right with one amount, another effect, and one of which a part is fixed.
gap::ModelShape some_shape() {
    gap::ModelShape shape;
    shape.amounts = {{{2}}, {{3, 4}}, {{5}}, {{7}}};
    shape.fixed = {6, 8};
    return shape;
}
const Eigen::VectorXd kPoint = (Eigen::VectorXd(8) << 0.04, -1.1, 1.7, 5.2, 0.3, -0.8, 2.1, 0.05).finished();

// What the equations of fit.hpp leave, row by row.
Eigen::VectorXd residual(const Eigen::MatrixXd& x, std::size_t e, const Eigen::VectorXd& p) {
    const double product = e == gap::kLinear ? p(0) : p(1);
    const double gain = e == gap::kLinear ? p(2) : p(3);
    return product * x.col(0) +
           gain * (x.col(1) + p(4) * x.col(2) + p(5) * (x.col(3) + x.col(4)) + p(6) * x.col(5) +
                   p(7) * x.col(7) + x.col(6) + x.col(8)) -
           x.col(kColumns - 1);
}

}  // namespace

TEST_GROUP(GapDirections){};

// Against the rows themselves, and central differences of theirs: the residual is linear in each parameter.
TEST(GapDirections, a_tangent_is_that_of_the_rows_squares) {
    const Eigen::MatrixXd x = random_rows(4);
    const std::vector<int> beside{9, 10};
    const gap::Directions directions(some_shape(), kColumns - 1, beside);
    const Eigen::MatrixXd r = gap::by_direction(x.transpose() * x, directions);
    for (const std::size_t e : {gap::kLinear, gap::kTurning}) {
        const Eigen::VectorXd rest = residual(x, e, kPoint);
        Eigen::MatrixXd slope(x.rows(), 10);
        for (Eigen::Index i = 0; i < 8; ++i) {
            Eigen::VectorXd up = kPoint;
            Eigen::VectorXd down = kPoint;
            up(i) += 0.5;
            down(i) -= 0.5;
            slope.col(i) = residual(x, e, up) - residual(x, e, down);
        }
        slope.rightCols(2) = x.middleCols(9, 2);
        const Eigen::MatrixXd normal = slope.transpose() * slope;
        const Eigen::VectorXd gradient = -slope.transpose() * rest;

        gap::Tangent tangent(directions, e);
        tangent.move(kPoint);
        DOUBLES_EQUAL(rest.squaredNorm(), tangent.squares(r), 1e-10 * rest.squaredNorm());
        DOUBLES_EQUAL(rest.squaredNorm(), directions.combination(tangent.row()).squares(x.transpose() * x),
                      1e-10 * rest.squaredNorm());
        Eigen::MatrixXd found = Eigen::MatrixXd::Zero(10, 10);
        Eigen::VectorXd found_gradient = Eigen::VectorXd::Zero(10);
        tangent.add_with_more(r, 8, found, found_gradient);
        for (Eigen::Index i = 0; i < 10; ++i) {
            DOUBLES_EQUAL(gradient(i), found_gradient(i), 1e-9 * gradient.norm());
            for (Eigen::Index j = 0; j <= i; ++j)
                DOUBLES_EQUAL(normal(i, j), found(i, j), 1e-10 * normal.norm());
        }
    }
}
