#include "tools/gap/model/products.hpp"

#include <cblas.h>

#include <algorithm>
#include <mutex>

namespace wheelwright::gap {
namespace {

blasint size(Eigen::Index n) { return static_cast<blasint>(n); }
// BLAS wants a distance between columns of one at least, of an empty matrix too.
blasint stride(const Eigen::MatrixXd& a) { return std::max<blasint>(1, size(a.rows())); }

// Held during a call of the library.
std::unique_lock<std::mutex> library() {
    static std::mutex mutex;
    static const bool safe = [] {
        openblas_set_num_threads(1);
        return openblas_get_parallel() != OPENBLAS_SEQUENTIAL;
    }();
    return safe ? std::unique_lock<std::mutex>() : std::unique_lock(mutex);
}

}  // namespace

Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    Eigen::MatrixXd c(a.rows(), b.cols());
    const auto held = library();
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, size(a.rows()), size(b.cols()), size(a.cols()),
                1.0, a.data(), stride(a), b.data(), stride(b), 0.0, c.data(), stride(c));
    return c;
}

Eigen::MatrixXd times_itself(const Eigen::MatrixXd& a) {
    Eigen::MatrixXd c(a.rows(), a.rows());
    const auto held = library();
    cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, size(a.rows()), size(a.cols()), 1.0, a.data(),
                stride(a), 0.0, c.data(), stride(c));
    for (Eigen::Index j = 1; j < c.cols(); ++j) c.col(j).head(j) = c.row(j).head(j).transpose();
    return c;
}

Eigen::MatrixXd solved_lower(const Eigen::MatrixXd& lower, Eigen::MatrixXd b) {
    const auto held = library();
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, size(b.rows()),
                size(b.cols()), 1.0, lower.data(), stride(lower), b.data(), stride(b));
    return b;
}

}  // namespace wheelwright::gap
