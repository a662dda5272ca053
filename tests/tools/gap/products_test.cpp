#include "tools/gap/model/products.hpp"

#include <CppUTest/TestHarness.h>

#include <Eigen/Core>
#include <array>
#include <thread>

using namespace wheelwright;

namespace {

// Numbers between -1 and 1.
Eigen::MatrixXd some(Eigen::Index rows, Eigen::Index columns, unsigned seed) {
    Eigen::MatrixXd m(rows, columns);
    unsigned state = seed;
    for (double& x : m.reshaped()) {
        state = state * 1664525U + 1013904223U;
        x = double(state >> 8U) / double(1U << 23U) - 1;
    }
    return m;
}

// Element by element, from the definition.
void check(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, const Eigen::MatrixXd& c) {
    CHECK_EQUAL(a.rows(), c.rows());
    CHECK_EQUAL(b.cols(), c.cols());
    for (Eigen::Index i = 0; i < c.rows(); ++i) {
        for (Eigen::Index j = 0; j < c.cols(); ++j) {
            double sum = 0;
            for (Eigen::Index k = 0; k < a.cols(); ++k) sum += a(i, k) * b(k, j);
            DOUBLES_EQUAL(sum, c(i, j), 1e-12);
        }
    }
}

}  // namespace

TEST_GROUP(GapProducts){};

TEST(GapProducts, of_any_size) {
    for (const Eigen::Index rows : {1, 3, 8, 9, 21}) {
        for (const Eigen::Index inner : {1, 7, 40}) {
            for (const Eigen::Index columns : {1, 3, 4, 11}) {
                const Eigen::MatrixXd a = some(rows, inner, 3);
                const Eigen::MatrixXd b = some(inner, columns, 5);
                check(a, b, gap::product(a, b));
            }
        }
    }
}

TEST(GapProducts, of_a_matrix_and_itself) {
    for (const Eigen::Index rows : {1, 2, 5, 8, 13, 34}) {
        const Eigen::MatrixXd a = some(rows, 17, 7);
        const Eigen::MatrixXd c = gap::times_itself(a);
        check(a, a.transpose(), c);
        CHECK(c == c.transpose());
    }
}

TEST(GapProducts, solved_by_a_lower_triangle) {
    for (const Eigen::Index rows : {1, 3, 9, 20}) {
        Eigen::MatrixXd lower = some(rows, rows, 11);
        lower.diagonal().array() += 4;
        const Eigen::MatrixXd b = some(rows, 5, 13);
        const Eigen::MatrixXd solved = gap::solved_lower(lower, b);
        check(lower.triangularView<Eigen::Lower>(), solved, b);
    }
}

// Debian's serial build of OpenBLAS fails here: one product of 2000 or so.
TEST(GapProducts, of_several_threads_are_those_of_one) {
    const Eigen::MatrixXd a = some(60, 100, 3);
    const Eigen::MatrixXd b = some(100, 60, 5);
    const Eigen::MatrixXd c = gap::product(a, b);
    std::array<int, 3> wrong{};
    std::array<std::thread, 3> threads;
    for (std::size_t i = 0; i < threads.size(); ++i) {
        threads[i] = std::thread([&, i] {
            for (int n = 0; n < 5000; ++n) wrong[i] += gap::product(a, b) != c;
        });
    }
    for (std::thread& thread : threads) thread.join();
    CHECK_EQUAL(0, wrong[0] + wrong[1] + wrong[2]);
}
