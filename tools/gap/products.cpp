#include "tools/gap/products.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

namespace wheelwright::gap {
namespace {

constexpr std::size_t kLanes = 4;    // numbers in a vector
constexpr std::size_t kAbreast = 2;  // vectors
constexpr std::size_t kColumns = 4;  // of b and c at a time
constexpr std::size_t kRows = kLanes * kAbreast;

// On a processor with shorter vectors the compiler makes several of one.
using Lanes [[gnu::vector_size(kLanes * sizeof(double)), gnu::aligned(sizeof(double)), gnu::may_alias]] =
    double;

// Columns of b and of c; a's begin `stride` apart.
struct Panel {
    std::size_t rows, inner, stride;
    const double* a;
    std::array<const double*, kColumns> b;
    std::array<double*, kColumns> c;
};

// c = a b.
[[gnu::always_inline]] inline void multiply(const Panel& p) {
    std::size_t i = 0;
    for (; i + kRows <= p.rows; i += kRows) {
        Lanes sum[kColumns][kAbreast] = {};  // NOLINT(modernize-avoid-c-arrays): of registers
        const double* a = p.a + i;
        for (std::size_t k = 0; k < p.inner; ++k, a += p.stride) {
            for (std::size_t v = 0; v < kAbreast; ++v) {
                const Lanes rows = *reinterpret_cast<const Lanes*>(a + v * kLanes);
                for (std::size_t j = 0; j < kColumns; ++j) sum[j][v] += rows * p.b[j][k];
            }
        }
        for (std::size_t j = 0; j < kColumns; ++j) {
            for (std::size_t v = 0; v < kAbreast; ++v) {
                *reinterpret_cast<Lanes*>(p.c[j] + i + v * kLanes) = sum[j][v];
            }
        }
    }
    for (; i < p.rows; ++i) {
        std::array<double, kColumns> sum{};
        const double* a = p.a + i;
        for (std::size_t k = 0; k < p.inner; ++k, a += p.stride) {
            for (std::size_t j = 0; j < kColumns; ++j) sum[j] += *a * p.b[j][k];
        }
        for (std::size_t j = 0; j < kColumns; ++j) p.c[j][i] = sum[j];
    }
}

void multiply_anywhere(const Panel& p) { multiply(p); }

#ifdef __x86_64__
[[gnu::target("avx2,fma")]] void multiply_wide(const Panel& p) { multiply(p); }

void multiply_here(const Panel& p) {
    static const auto here = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0
                                 ? multiply_wide
                                 : multiply_anywhere;
    here(p);
}
#else
void multiply_here(const Panel& p) { multiply_anywhere(p); }
#endif

// Four columns of c = a b from row `first` on; of columns that are not there, the last in their place.
void columns(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, Eigen::MatrixXd& c, Eigen::Index column,
             Eigen::Index first) {
    Panel p{static_cast<std::size_t>(a.rows() - first),
            static_cast<std::size_t>(a.cols()),
            static_cast<std::size_t>(a.rows()),
            a.data() + first,
            {},
            {}};
    for (std::size_t j = 0; j < kColumns; ++j) {
        const Eigen::Index at = std::min(column + static_cast<Eigen::Index>(j), c.cols() - 1);
        p.b[j] = b.data() + at * b.rows();
        p.c[j] = c.data() + at * c.rows() + first;
    }
    multiply_here(p);
}

}  // namespace

Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    Eigen::MatrixXd c(a.rows(), b.cols());
    for (Eigen::Index j = 0; j < c.cols(); j += kColumns) columns(a, b, c, j, 0);
    return c;
}

Eigen::MatrixXd times_itself(const Eigen::MatrixXd& a) {
    const Eigen::MatrixXd b = a.transpose();
    Eigen::MatrixXd c(a.rows(), a.rows());
    for (Eigen::Index j = 0; j < c.cols(); j += kColumns) columns(a, b, c, j, j);
    c.triangularView<Eigen::StrictlyUpper>() = c.transpose().eval();
    return c;
}

}  // namespace wheelwright::gap
