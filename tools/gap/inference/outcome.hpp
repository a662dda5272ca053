// What is said of the effects that a search has found: their parameters and how far these are known, and
// which rivals are not ruled out.
#pragma once

#include <cstddef>
#include <map>
#include <vector>

#include "tools/gap/inference/evidence.hpp"
#include "tools/gap/inference/search.hpp"

namespace wheelwright::gap {

// Fills `effects`, the one that closes most first, from `members`, `base_members`, `after` and the gaps, and
// adds to `points` where rivals fit best. `probability` of each member, that it is not there.
void describe_effects(const Evidence& evidence, const std::map<std::size_t, double>& probability,
                      Search& found);

// Of the closable gap, from -1 to 1: of blocks held out, that took no part, or where there are none of those
// that were fitted to.
double closed_share(const Blocks& held_out, const Search& found);

// The named effects with parameters and intervals taken from `after` anew, once that has been refined.
std::vector<NamedEffect> described_anew(const Search& search, const Setting& setting);

}  // namespace wheelwright::gap
