// The identification library with double, for machines that have it.
#include "firmware/ident/adaptive_estimator.hpp"
#include "firmware/ident/arx.hpp"
#include "firmware/ident/identification_run.hpp"
#include "firmware/ident/model_guard.hpp"

namespace wheelwright::ident {

template class UdRls<double, 2>;
template class ArxRegressor<double, 2, 2>;
template class IdentificationRun<double>;
template class AdaptiveEstimator<double>;
template class ModelGuard<double>;

}  // namespace wheelwright::ident
