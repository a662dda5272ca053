// Paper eq (29)-(31) letter by letter: what the firmware does not use, for comparison.
#pragma once

#include <Eigen/Dense>

namespace wheelwright::test {

template <typename Real, int N>
struct TextbookRls {
    using Vector = Eigen::Matrix<Real, N, 1>;
    using Matrix = Eigen::Matrix<Real, N, N>;
    Vector theta = Vector::Zero();
    Matrix p = Matrix::Identity();

    void update(const Vector& phi, Real y) {
        const Vector gain = p * phi / (1 + phi.dot(p * phi));
        theta += gain * (y - phi.dot(theta));
        p = (Matrix::Identity() - gain * phi.transpose()) * p;
    }
    bool positive() const { return Eigen::LLT<Matrix>(p).info() == Eigen::Success; }
};

// Batch least squares by QR of the rows, taken in blocks so that a million fit: the oracle.
template <int N>
class BatchQr {
  public:
    using Vector = Eigen::Matrix<double, N, 1>;

    template <typename Phi>
    void add(const Phi& phi, double y) {
        for (int i = 0; i < N; ++i) block_(used_, i) = phi[static_cast<std::size_t>(i)];
        block_(used_, N) = y;
        if (++used_ == kRows) reduce();
    }
    Vector solve() {
        reduce();
        const Eigen::Matrix<double, N, N> r = block_.template topLeftCorner<N, N>();
        return r.template triangularView<Eigen::Upper>().solve(block_.template block<N, 1>(0, N));
    }
    // inverse of sum(phi phi^T)
    Eigen::Matrix<double, N, N> covariance() {
        reduce();
        const Eigen::Matrix<double, N, N> inverse =
            block_.template topLeftCorner<N, N>().template triangularView<Eigen::Upper>().solve(
                Eigen::Matrix<double, N, N>::Identity());
        return inverse * inverse.transpose();
    }
    Eigen::Matrix<double, N, 1> singular_values() {
        reduce();
        return Eigen::JacobiSVD<Eigen::Matrix<double, N, N>>(block_.template topLeftCorner<N, N>())
            .singularValues();
    }

  private:
    static constexpr Eigen::Index kRows = 512;
    // The triangle so far stays in the first N + 1 rows.
    void reduce() {
        Eigen::HouseholderQR<Eigen::Matrix<double, kRows, N + 1>> qr(block_);
        const Eigen::Matrix<double, N + 1, N + 1> r =
            qr.matrixQR().template topRows<N + 1>().template triangularView<Eigen::Upper>();
        block_.setZero();
        block_.template topRows<N + 1>() = r;
        used_ = N + 1;
    }

    Eigen::Matrix<double, kRows, N + 1> block_ = Eigen::Matrix<double, kRows, N + 1>::Zero();
    Eigen::Index used_ = N + 1;
};

}  // namespace wheelwright::test
