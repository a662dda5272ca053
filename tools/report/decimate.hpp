// Thins curves for the screen without losing what an eye would see.
#pragma once

#include <cstddef>
#include <vector>

namespace wheelwright::report {

// Indices to keep, ascending, of a curve y(x) with x ascending. The x axis is cut into buckets of equal width
// (equal ratio if `log_x`, where x <= 0 is left out), and of each the first, lowest, highest and last point
// stay: peaks stay, and stay where they are. At most about `points`. Breaks (values that are not finite) stay
// as one index each. Everything is kept when nothing needs to go.
std::vector<std::size_t> thin_curve(const std::vector<double>& x, const std::vector<double>& y,
                                    std::size_t points, bool log_x);

// The same for a path in the plane, whose x may go back and forth: the fewest points from which it departs by
// at most 1/3000 of its extent (Ramer, Douglas, Peucker), and evenly fewer should that still be too many.
std::vector<std::size_t> thin_path(const std::vector<double>& x, const std::vector<double>& y,
                                   std::size_t points);

}  // namespace wheelwright::report
