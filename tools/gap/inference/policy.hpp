// The thresholds of the search and of what is said of its outcome: here and nowhere else, and no options.
// docs/gap.md says what they are for. Shares are of 1.
#pragma once

#include <cstddef>

namespace wheelwright::gap {

// What is found. Levels of tests, after Holm over the catalogue; where it is the first effect.
inline constexpr double kSignificance = 0.01;
inline constexpr double kSignificanceAlone = 0.02;
// What it gains, as a share of the closable gap that is left, and of that at first.
inline constexpr double kLeastShareOfClosable = 0.2;
inline constexpr double kLeastShareOfAll = 0.001;
// RMS of its torque over RMS of the torque; where nothing else is found.
inline constexpr double kSizeOfInterest = 0.01;
inline constexpr double kSizeOfInterestAlone = kSizeOfInterest / 3;
// Fewer blocks in which it acts are no reason to leave the others out. A block in which its columns have less
// than this share of their power where they have most is none of them.
inline constexpr std::size_t kFewestActing = 5;
inline constexpr double kActs = 0.02;
// Power of a coordinate's column over that of the effect's strongest: less of it is not in the log.
inline constexpr double kUnexcited = 1e-4;
inline constexpr std::size_t kMostEffects = 4;

// Probability of what is not confirmed, up to which it is worth a closer look though little is missing.
inline constexpr double kSureLead = 1e-6;

// How it enters. Left and right get an amount each from so many standard errors of their difference on.
inline constexpr double kApart = 4;
// Share of a closer look's squares that a point of the first grid must leave to be preferred to it.
inline constexpr double kCloser = 0.98;
// Probability that it is not there, above which it goes again though it was accepted once.
inline constexpr double kSuperfluous = 0.05;

// Whether one model is better than another. Probability of three standard errors.
inline constexpr double kToldApart = 0.0027;
// Share of what is left, by which it must be better to be so.
inline constexpr double kTrifle = 0.01;
// Blocks that they are compared on, at least: fewer would have to agree in all their ranks.
inline constexpr std::size_t kFewestParting = 8;

// Rivals. Likeness in this log above which no log like it separates.
inline constexpr double kAlike = 0.999;
// Share of its gain that a rival may lose and still be tied.
inline constexpr double kTied = 0.05;
// A rival's loss below these shares of the gain is none: no model of a robot is so exact; where it is what
// both foretell, piece by piece, it is more surely the rival's.
inline constexpr double kTrifleOfGain = 0.0005;
inline constexpr double kTrifleOfGainForetold = 0.0001;
// Share of the gain, kept by a rival with more unknowns, that is chance.
inline constexpr double kNoBetter = 1.005;

// The verdict. Closable gap as a share of what torque does: small; left over, unexplained.
inline constexpr double kSmallGap = 0.01;
inline constexpr double kLargeGap = 0.03;
// The same behind a late report, which is known only so well.
inline constexpr double kGapBehindLag = 0.06;
// Share of the closable torque that is unexplained too, left beside what was named.
inline constexpr double kShareLeft = 0.10;
// What depends on a place is unexplained from these shares of the torque on, where nothing or something was
// named; in the latter case also of what all that explains. Columns that know nothing of an effect show part
// of it only.
inline constexpr double kShown = kSizeOfInterestAlone;
inline constexpr double kShownBeside = kSizeOfInterest / 2;
inline constexpr double kShareShownBeside = 0.2;

}  // namespace wheelwright::gap
