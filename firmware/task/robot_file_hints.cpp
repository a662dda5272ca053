#include "firmware/task/robot_file_hints.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>

#include "firmware/task/robot_file.hpp"

namespace wheelwright::task {
namespace {

struct UnitSuffix {
    std::string_view suffix;  // lower case
    std::string_view name;
    std::string_view si;  // our unit of the same quantity; "" when the suffix says nothing about it
    double factor;        // our unit per theirs
};

constexpr double kPi = 3.14159265358979323846;

// Longest first, so that "_mm_per_s" is not taken for "_s".
constexpr std::array kSuffixes{
    UnitSuffix{"_deg_per_s2", "deg/s^2", "rad/s^2", kPi / 180},
    UnitSuffix{"_rad_per_s2", "rad/s^2", "rad/s^2", 1},
    UnitSuffix{"_kbit_per_s", "kbit/s", "bit/s", 1e3},
    UnitSuffix{"_mbit_per_s", "Mbit/s", "bit/s", 1e6},
    UnitSuffix{"_bit_per_s", "bit/s", "bit/s", 1},
    UnitSuffix{"_deg_per_s", "deg/s", "rad/s", kPi / 180},
    UnitSuffix{"_rad_per_s", "rad/s", "rad/s", 1},
    UnitSuffix{"_cm_per_s", "cm/s", "m/s", 1e-2},
    UnitSuffix{"_mm_per_s", "mm/s", "m/s", 1e-3},
    UnitSuffix{"_km_per_h", "km/h", "m/s", 1 / 3.6},
    UnitSuffix{"_m_per_s2", "m/s^2", "m/s^2", 1},
    UnitSuffix{"_kg_cm2", "kg cm^2", "kg m^2", 1e-4},
    UnitSuffix{"_m_per_s", "m/s", "m/s", 1},
    UnitSuffix{"_degrees", "deg", "rad", kPi / 180},
    UnitSuffix{"_kg_m2", "kg m^2", "kg m^2", 1},
    UnitSuffix{"_inch", "inch", "m", 0.0254},
    UnitSuffix{"_kmh", "km/h", "m/s", 1 / 3.6},
    UnitSuffix{"_deg", "deg", "rad", kPi / 180},
    UnitSuffix{"_rad", "rad", "rad", 1},
    UnitSuffix{"_rpm", "rev/min", "rad/s", kPi / 30},
    UnitSuffix{"_mnm", "mNm", "Nm", 1e-3},
    UnitSuffix{"_ncm", "N cm", "Nm", 1e-2},
    UnitSuffix{"_mps", "m/s", "m/s", 1},
    UnitSuffix{"_bps", "bit/s", "bit/s", 1},
    UnitSuffix{"_nm", "Nm", "Nm", 1},
    UnitSuffix{"_mm", "mm", "m", 1e-3},
    UnitSuffix{"_cm", "cm", "m", 1e-2},
    UnitSuffix{"_in", "inch", "m", 0.0254},
    UnitSuffix{"_ft", "ft", "m", 0.3048},
    UnitSuffix{"_ms", "ms", "s", 1e-3},
    UnitSuffix{"_us", "us", "s", 1e-6},
    UnitSuffix{"_ns", "ns", "s", 1e-9},
    UnitSuffix{"_kg", "kg", "kg", 1},
    UnitSuffix{"_g", "g", "kg", 1e-3},
    UnitSuffix{"_m", "m", "m", 1},
    UnitSuffix{"_s", "s", "s", 1},
};

std::string lower(std::string_view text) {
    std::string result(text);
    for (char& c : result) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return result;
}

struct Word {
    std::string stem;                    // without unit, lower case
    const UnitSuffix* suffix = nullptr;  // nullptr: no unit known
};

Word split_unit(std::string_view segment) {
    const std::string word = lower(segment);
    for (const UnitSuffix& suffix : kSuffixes) {
        if (word.size() > suffix.suffix.size() && word.ends_with(suffix.suffix)) {
            return {word.substr(0, word.size() - suffix.suffix.size()), &suffix};
        }
    }
    return {word, nullptr};
}

struct Place {
    std::string_view parent;  // "" for the root
    std::string_view last;
};

Place split_path(std::string_view path) {
    const std::size_t dot = path.rfind('.');
    if (dot == std::string_view::npos) return {"", path};
    return {path.substr(0, dot), path.substr(dot + 1)};
}

struct Candidate {
    std::string path;
    std::string_view unit;
    bool table = false;
    std::string children;  // of a table
};

// Everything that may stand directly in `parent`.
std::vector<Candidate> children_of(std::string_view parent, std::span<const KnownKey> known) {
    std::vector<Candidate> result;
    const std::string prefix = parent.empty() ? "" : std::string(parent) + ".";
    for (const KnownKey& key : known) {
        if (!key.path.starts_with(prefix)) continue;
        const std::string_view rest = std::string_view(key.path).substr(prefix.size());
        const std::size_t dot = rest.find('.');
        if (dot == std::string_view::npos) {
            result.push_back({key.path, key.unit, false, ""});
            continue;
        }
        const std::string path = prefix + std::string(rest.substr(0, dot));
        if (result.empty() || result.back().path != path) {
            result.push_back({path, key.unit, true, ""});
        } else {
            result.back().children += ", ";
        }
        result.back().children += rest.substr(dot + 1);
    }
    return result;
}

std::string describe(const Candidate& meant, const Word& written, std::optional<double> value) {
    std::string text = "did you mean " + meant.path + "?";
    if (meant.table && !split_path(meant.path).parent.empty()) {
        text += " It is a table with " + meant.children;
    }
    if (written.suffix != nullptr && written.suffix->si == meant.unit && written.suffix->factor != 1) {
        text += meant.table ? ", in " : " It is in ";
        text += meant.unit;
        if (value.has_value()) {
            std::array<char, 64> line{};
            std::snprintf(line.data(), line.size(), ": %.12g %.*s is %.12g ", *value,
                          static_cast<int>(written.suffix->name.size()), written.suffix->name.data(),
                          *value * written.suffix->factor);
            text += line.data() + std::string(meant.unit);
        }
    }
    return text;
}

}  // namespace

unsigned edit_distance(std::string_view a, std::string_view b) {
    const std::size_t width = b.size() + 1;
    std::vector<unsigned> table((a.size() + 1) * width);
    const auto at = [&](std::size_t i, std::size_t j) -> unsigned& { return table[i * width + j]; };
    for (std::size_t i = 0; i <= a.size(); ++i) at(i, 0) = static_cast<unsigned>(i);
    for (std::size_t j = 0; j <= b.size(); ++j) at(0, j) = static_cast<unsigned>(j);
    for (std::size_t i = 1; i <= a.size(); ++i) {
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const unsigned change = a[i - 1] == b[j - 1] ? 0 : 1;
            at(i, j) = std::min({at(i - 1, j) + 1, at(i, j - 1) + 1, at(i - 1, j - 1) + change});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
                at(i, j) = std::min(at(i, j), at(i - 2, j - 2) + 1);
            }
        }
    }
    return table.back();
}

std::string hint_for_unknown(std::string_view path, std::optional<double> value,
                             std::span<const KnownKey> known) {
    const Place place = split_path(path);
    const Word word = split_unit(place.last);
    const std::vector<Candidate> siblings = children_of(place.parent, known);

    for (const Candidate& candidate : siblings) {  // right word, other unit
        const Word its = split_unit(split_path(candidate.path).last);
        if (its.stem == word.stem) return describe(candidate, word, value);
    }
    const Candidate* nearest = nullptr;
    unsigned least = 0;
    for (const Candidate& candidate : siblings) {
        const std::string_view its = split_path(candidate.path).last;
        const unsigned distance =
            std::min(edit_distance(lower(its), lower(place.last)),
                     edit_distance(split_unit(its).stem, word.stem) + (word.suffix == nullptr ? 0U : 1U));
        if (nearest == nullptr || distance < least) {
            nearest = &candidate;
            least = distance;
        }
    }
    const auto limit = std::max<std::size_t>(2, place.last.size() / 4);
    if (nearest != nullptr && least <= limit && least < place.last.size()) {
        return describe(*nearest, word, value);
    }
    for (const KnownKey& key : known) {  // right key in the wrong table
        const Place its = split_path(key.path);
        if (its.last == place.last) {
            return std::string(its.last) + " belongs in [" + std::string(its.parent) + "]";
        }
    }
    for (const KnownKey& key : known) {
        const Place its = split_path(key.path);
        if (split_unit(its.last).stem == word.stem) {
            return describe({key.path, key.unit, false, ""}, word, value);
        }
    }
    return "";
}

}  // namespace wheelwright::task
