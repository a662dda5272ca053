// Functions whose last bit differs between machines' mathematical libraries, written with plain arithmetic:
// the simulation gives the same bits wherever IEEE 754 holds. (sim_hal is compiled without contraction of
// products and sums for the same reason.)
#pragma once

#include "firmware/model/exponential.hpp"
#include "firmware/model/sine_cosine.hpp"

namespace wheelwright::sim {

using model::exp_minus;
using model::mean_exp_minus;
using model::sine_cosine;
using SineCosine = model::SineCosine<double>;

}  // namespace wheelwright::sim
