// Compiles the whole identification library once, so that a template that breaks, breaks here; with double in
// ident_double.cpp.
#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/arx.hpp"
#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/model_guard.hpp"

namespace wheelwright::ident {

template class UdRls<float, 2>;
template class ArxRegressor<float, 2, 2>;
template class IdentificationRun<float>;
template class AdaptiveEstimator<float>;
template class ModelGuard<float>;

}  // namespace wheelwright::ident
