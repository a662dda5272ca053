// Regression vector of an ARX model, paper eq (1)-(4):
//   y(t+1) = a_1 y(t) + ... + a_p y(t-p+1) + b_1 u(t) + ... + b_q u(t-q+1) + noise
#pragma once

#include <array>
#include <cstddef>

namespace wheelwright::ident {

template <typename Real, int kOutputs, int kInputs>
class ArxRegressor {
  public:
    static constexpr int kSize = kOutputs + kInputs;  // theta = (a_1 .. a_p, b_1 .. b_q)
    using Vector = std::array<Real, kSize>;

    // Takes y(t) and u(t); phi() is then phi(t), which predicts y(t+1).
    void push(Real y, Real u) {
        shift_in(0, kOutputs, y);
        shift_in(kOutputs, kInputs, u);
        if (count_ < kSize) ++count_;
    }

    const Vector& phi() const { return phi_; }

    // False until phi() holds only values that were pushed.
    bool full() const { return count_ >= (kOutputs > kInputs ? kOutputs : kInputs); }

  private:
    void shift_in(int begin, int length, Real value) {
        for (int i = begin + length - 1; i > begin; --i)
            phi_[static_cast<std::size_t>(i)] = phi_[static_cast<std::size_t>(i - 1)];
        if (length > 0) phi_[static_cast<std::size_t>(begin)] = value;
    }

    Vector phi_{};
    int count_ = 0;
};

}  // namespace wheelwright::ident
