// What the analysis may get wrong how often, and how large a thing has to be to be of interest: all that its
// decisions are made from, here and nowhere else, and no options. Numbers of an estimator or a test stand
// where that is.
#pragma once

namespace wheelwright::gap {

struct Policy {
    // Error rates. Of what is said to be there and is not: after Holm over the catalogue; the first effect
    // has the whole log's evidence to itself, and one that no log needs is worth missing less than one that
    // it does.
    double false_alarm = 0.01;
    double first_false_alarm = 0.02;
    // Of what was accepted once, or belongs to every drive train, when it is asked for again beside the
    // others: it must not be sure twice.
    double kept = 0.05;
    // Of calling one model better than another: three standard errors.
    double better = 0.0027;

    // Sizes of interest, as shares of the torque (RMS over RMS). A hundredth is what torque constants and
    // currents are known to at best; where nothing else is found the rest of the torque is explained three
    // times as well.
    double effect = 0.01;
    double effect_alone = effect / 3;
    // A gap that is unexplained: three times an effect, as one that no single effect explains is made of
    // several; and behind speeds that are reported late, by a lag that is known to a twentieth, six times.
    double gap = 3 * effect;
    double gap_behind_lag = 6 * effect;
    // What depends on a place: beside effects, whose laws are not exactly the robot's, half of an effect.
    double place = effect_alone;
    double place_beside = effect / 2;

    // Of what is missing: what a further effect has to explain, and what is unexplained of a place.
    double share_of_gap = 0.2;
    // Of what was missing at first: what is left of it when all is explained is not worth a name.
    double share_of_first_gap = 0.001;
    // Of the closable torque, unexplained beside effects.
    double share_unexplained = 0.1;
    // Of the squares: how much better a model is at least.
    double better_by = 0.01;
};

inline constexpr Policy kPolicy;

}  // namespace wheelwright::gap
