// The two matrix products in which an analysis of a log spends most of its time, with the widest vectors that
// the processor has: Eigen uses those that it was compiled for, which every processor has. Differently wide
// vectors add in the same order and differ by a rounding where there is a fused multiply-add.
#pragma once

#include <Eigen/Core>

namespace wheelwright::gap {

// a b.
Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

// a a^T.
Eigen::MatrixXd times_itself(const Eigen::MatrixXd& a);

}  // namespace wheelwright::gap
