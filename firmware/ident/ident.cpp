// Compiles the whole identification library once in both scalars, so that a template that breaks, breaks
// here.
#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/arx.hpp"
#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/model_guard.hpp"

namespace wheelwright::ident {

template class UdRls<float, 2>;
template class UdRls<double, 2>;
template class ArxRegressor<float, 2, 2>;
template class ArxRegressor<double, 2, 2>;
template class IdentificationRun<float>;
template class IdentificationRun<double>;
template class AdaptiveEstimator<float>;
template class AdaptiveEstimator<double>;
template class ModelGuard<float>;
template class ModelGuard<double>;

}  // namespace wheelwright::ident
