// Student's t. Some 50 operations.
#pragma once

#include <cmath>

namespace wheelwright::ident {

// A standard error from a few measurements may be much too small by chance. By how much it has to be larger
// so that `errors` of it are exceeded as seldom as so many of a known one; `freedom`: the measurements less
// what was estimated from them. Wallace's approximation (1959, Annals of Mathematical Statistics 30): never
// too small, by 2 % too large with 8 degrees of freedom, by a quarter with 3.
template <typename Real>
Real error_of_few(Real errors, Real freedom) {
    const Real e = errors * (8 * freedom + 3) / (8 * freedom + 1);
    return std::sqrt(freedom * std::expm1(e * e / freedom)) / errors;
}

}  // namespace wheelwright::ident
