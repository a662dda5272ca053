// The measures that further analyses (further.hpp) are counted by.
//
// A7: the hidden effect is held out of the library, and with it what holds it as a special case. Right is the
//   verdict `unexplained` with a right place among the first two of `where`; which are right is a matter of
//   physics, and stands in kPlaces of further_measures.cpp. Identifiable single effects, medium and strong,
//   that move a wheel. Where another effect of the catalogue leaves less than a tenth of what the hidden one
//   closes of the gap (unexplained squares, by the oracle), to name that one is what anybody would do: such
//   trials are not counted. The remark says how many these are, and of those counted how often a name was
//   given and how often nothing was found missing or the log was said not to tell.
// C2: the error of the extended model's free run over 5 s windows of the held-out part over that of the true
//   model in the same simulator, median; single effects that are identifiable and were named exactly.
// D3: two logs of one robot are answered alike when the verdict is the same and, where names are given, these
//   are the same set. Counted are trials of which the oracle says that each of the two logs can tell; how it
//   is with all stands in the remark.
// A9: of the trials that hide one of the effects which the advised motion is to tell apart, those whose
//   second answer, to all logs, is `named` with exactly what is hidden, and lists none of those effects
//   as a rival of another any more.
#pragma once

#include <vector>

#include "tools/gap_trials/judge.hpp"

namespace wheelwright::tools {

std::vector<Measure> further_measures(const std::vector<Outcome>& outcomes);

// What was said of the effects held out.
std::vector<HeldOut> held_out(const std::vector<Outcome>& outcomes);

}  // namespace wheelwright::tools
