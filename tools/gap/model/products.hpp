// The matrix operations in which an analysis of a log spends most of its time, by OpenBLAS, which takes the
// widest vectors that the processor has; Eigen takes those that it was compiled for, which every processor
// has. Processors may differ by roundings, calls on one do not. Any shape that multiplies, empty ones
// included. Safe from several threads; each call works in the thread that made it. (OpenBLAS's serial build
// is not safe; where the machine's alternatives put it in place of ours, one call waits for the other.)
#pragma once

#include <Eigen/Core>

namespace wheelwright::gap {

// a b: a's rows by b's columns. a.cols() == b.rows().
Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

// a a^T: both triangles, a.rows() square, at half the cost of product().
Eigen::MatrixXd times_itself(const Eigen::MatrixXd& a);

// L^-1 b, of the lower triangle L of `lower`, square and with no zero on its diagonal. lower.cols() ==
// b.rows().
Eigen::MatrixXd solved_lower(const Eigen::MatrixXd& lower, Eigen::MatrixXd b);

}  // namespace wheelwright::gap
