#include "tools/gap/model/directions.hpp"

#include <algorithm>
#include <array>

namespace wheelwright::gap {

double Combination::squares(const Eigen::MatrixXd& product) const {
    double sum = 0;
    for (std::size_t j = 0; j < column.size(); ++j) {
        const double* const from = product.col(column[j]).data();
        double others = 0;
        for (std::size_t i = j + 1; i < column.size(); ++i) others += weight[i] * from[column[i]];
        sum += weight[j] * (weight[j] * from[column[j]] + 2 * others);
    }
    return sum;
}

Directions::Directions(const ModelShape& shape, Eigen::Index y, std::span<const int> more)
    : amounts_(static_cast<Eigen::Index>(shape.amounts.size())) {
    put(std::array<int, 1>{Dictionary::kProduct});
    put(std::array<int, 1>{Dictionary::kTorque});
    for (const Amount& amount : shape.amounts) put(amount.columns);
    put(shape.fixed);
    put(std::array{static_cast<int>(y)});
    for (const int c : more) put(std::array{c});
}

void Directions::put(std::span<const int> columns) {
    column_.insert(column_.end(), columns.begin(), columns.end());
    first_.push_back(column_.size());
}

void Directions::add(const Eigen::MatrixXd& product, Eigen::MatrixXd& sum) const {
    const auto count = static_cast<std::size_t>(size());
    for (std::size_t j = 0; j < count; ++j) {
        double* const to = sum.col(static_cast<Eigen::Index>(j)).data();
        for (std::size_t b = first_[j]; b < first_[j + 1]; ++b) {
            const double* const from = product.col(column_[b]).data();
            for (std::size_t i = j; i < count; ++i) {
                for (std::size_t a = first_[i]; a < first_[i + 1]; ++a) to[i] += from[column_[a]];
            }
        }
    }
}

double Directions::power(const Eigen::MatrixXd& product, Eigen::Index amount) const {
    const auto i = static_cast<std::size_t>(kAmounts + amount);
    double sum = 0;
    for (std::size_t a = first_[i]; a < first_[i + 1]; ++a) sum += product(column_[a], column_[a]);
    return sum;
}

Combination Directions::combination(const Eigen::VectorXd& row) const {
    Combination made{column_, std::vector<double>(column_.size())};
    for (std::size_t i = 0; i + 1 < first_.size(); ++i)
        std::fill(made.weight.begin() + std::ptrdiff_t(first_[i]),
                  made.weight.begin() + std::ptrdiff_t(first_[i + 1]), row(Eigen::Index(i)));
    return made;
}

Eigen::MatrixXd by_direction(const Eigen::MatrixXd& product, const Directions& directions) {
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(directions.size(), directions.size());
    directions.add(product, sum);
    sum.triangularView<Eigen::StrictlyUpper>() = sum.transpose();
    return sum;
}

Eigen::MatrixXd by_direction(std::span<const Block* const> blocks, std::size_t equation,
                             const Directions& directions) {
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(directions.size(), directions.size());
    for (const Block* block : blocks) directions.add(block->product[equation], sum);
    sum.triangularView<Eigen::StrictlyUpper>() = sum.transpose();
    return sum;
}

namespace {

// a v, for matrices so small that a general product's preparations would take most of the time.
void multiply(const Eigen::MatrixXd& a, const Eigen::VectorXd& v, Eigen::VectorXd& to) {
    to.setZero(a.rows());
    for (Eigen::Index j = 0; j < v.size(); ++j) {
        if (v(j) != 0) to += v(j) * a.col(j);
    }
}

}  // namespace

Tangent::Tangent(const Directions& directions, std::size_t equation)
    : directions_(directions),
      product_(product_of(equation)),
      gain_at_(gain_of(equation)),
      row_(Eigen::VectorXd::Zero(directions.size())),
      by_gain_(Eigen::VectorXd::Zero(directions.size())) {
    row_(directions.y()) = -1;
    by_gain_(Directions::kTorque) = 1;
    by_gain_(directions.fixed()) = 1;
}

void Tangent::move(const Eigen::VectorXd& p) {
    const Eigen::Index amounts = directions_.amounts();
    gain_ = p(gain_at_);
    by_gain_.segment(Directions::kAmounts, amounts) = p.segment(kFirstAmount, amounts);
    row_(Directions::kProduct) = p(product_);
    row_(Directions::kTorque) = row_(directions_.fixed()) = gain_;
    row_.segment(Directions::kAmounts, amounts) = gain_ * p.segment(kFirstAmount, amounts);
}

double Tangent::squares(const Eigen::MatrixXd& r) {
    multiply(r, row_, with_row_);
    return row_.dot(with_row_);
}

void Tangent::add(const Eigen::MatrixXd& r, Eigen::MatrixXd& normal, Eigen::VectorXd& gradient) {
    constexpr Eigen::Index kProduct = Directions::kProduct;
    constexpr Eigen::Index kAmounts = Directions::kAmounts;
    const Eigen::Index amounts = directions_.amounts();
    multiply(r, row_, with_row_);
    multiply(r, by_gain_, with_gain_);
    gradient(product_) -= with_row_(kProduct);
    gradient(gain_at_) -= by_gain_.dot(with_row_);
    gradient.segment(kFirstAmount, amounts) -= gain_ * with_row_.segment(kAmounts, amounts);
    normal(product_, product_) += r(kProduct, kProduct);
    normal(gain_at_, product_) += with_gain_(kProduct);
    normal(gain_at_, gain_at_) += by_gain_.dot(with_gain_);
    normal.col(product_).segment(kFirstAmount, amounts) += gain_ * r.col(kProduct).segment(kAmounts, amounts);
    normal.col(gain_at_).segment(kFirstAmount, amounts) += gain_ * with_gain_.segment(kAmounts, amounts);
    for (Eigen::Index j = 0; j < amounts; ++j) {
        normal.col(kFirstAmount + j).segment(kFirstAmount + j, amounts - j) +=
            gain_ * gain_ * r.col(kAmounts + j).segment(kAmounts + j, amounts - j);
    }
}

void Tangent::add_with_more(const Eigen::MatrixXd& r, Eigen::Index at, Eigen::MatrixXd& normal,
                            Eigen::VectorXd& gradient) {
    const Eigen::Index amounts = directions_.amounts();
    const Eigen::Index more = directions_.more();
    const Eigen::Index count = directions_.size() - more;
    add(r, normal, gradient);
    gradient.segment(at, count) -= with_row_.segment(more, count);
    normal.block(at, product_, count, 1) += r.block(more, Directions::kProduct, count, 1);
    normal.block(at, gain_at_, count, 1) += with_gain_.segment(more, count);
    normal.block(at, kFirstAmount, count, amounts) +=
        gain_ * r.block(more, Directions::kAmounts, count, amounts);
    normal.block(at, at, count, count) += r.block(more, more, count, count);
}

}  // namespace wheelwright::gap
