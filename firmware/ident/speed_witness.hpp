// What speed does to pushed wheels beside torque and friction: K5 omega^2 and K6 v omega. It tells, without a
// look from outside, that a wheel is on the floor, and that not one wheel alone goes backwards.
//
// Each wheel is pushed in either direction, straight on and turning. Friction is the same in both motions of
// a wheel in one direction, so it cancels in their difference; scrub, which slows every turn alike, cancels
// between the directions. What is left, in a turn more than straight on, of the rims' acceleration along
// forward:
//     as filed    left +k, right +k    k = K5 omega^2 of the turn
//     mirrored    left +k, right -k    the push straight on was the turn (mirror_test.hpp)
//     lifted      0                    a wheel in the air knows nothing of the other one
//
// About 10 operations a push, 100 for an answer. No allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "firmware/ident/mirror_test.hpp"
#include "firmware/ident/parabola.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::ident {

class SpeedWitness {
  public:
    // A push there and back. `forward`: of the right wheel. `rim_m_per_s2`: each rim's mean acceleration
    // beside the torque's, positive along forward.
    void add(bool turning, bool forward, const WheelPair<double>& rim_m_per_s2) {
        means_[turning][0][forward != turning].add(rim_m_per_s2.left);
        means_[turning][1][forward].add(rim_m_per_s2.right);
    }

    // What slows the wheels straight on, their mean; 0 where none has been pushed.
    double friction_m_per_s2() const {
        double sum = 0;
        int cells = 0;
        for (const auto& wheel : means_[0]) {
            for (const bool forward : {false, true}) {
                if (wheel[forward].count() == 0) continue;
                sum += forward ? -wheel[forward].mean() : wheel[forward].mean();
                ++cells;
            }
        }
        return cells > 0 ? sum / cells : 0;
    }

    // This wheel is: it knows of the other one. False tells nothing.
    bool on_floor(std::size_t wheel) const {
        const Value seen = more_in_turn(wheel);
        const double slows = friction_m_per_s2() + std::max(scrub_m_per_s2(), 0.0);
        return std::abs(seen.value) >
               std::max((by_four() ? kWheelSureByFour : kWheelSure) * seen.error, kUnlikeTurns * slows);
    }

    // unknown until each wheel has been pushed twice in each direction, straight on and turning.
    Mirror judge_mirror() const { return judge(patterns()); }
    // With pushes of the same robot that were slower: what both see alike is not speed's, but dry friction's.
    Mirror judge_mirror(const SpeedWitness& slower) const {
        const Mirror alone = judge_mirror();
        if (alone != Mirror::unknown) return alone;
        const Patterns now = patterns(), before = slower.patterns();
        const bool by_four_each = by_four() && slower.by_four();
        return judge({now.filed - before.filed, now.mirrored - before.mirrored,
                      std::sqrt(now.error * now.error + before.error * before.error),
                      now.friction - before.friction, now.scrub - before.scrub,
                      by_four_each ? kSureByFourEach : sure()});
    }

  private:
    // Standard errors that chance exceeds twice in 10^5, by two pushes in each of eight cells, and by four in
    // those of the turns, in one witness or in two (ident.ProbeParts counts).
    static constexpr double kSure = 10, kSureByFour = 7.5, kSureByFourEach = 6.2;
    static constexpr double kWheelSure = 24, kWheelSureByFour = 7;  // the same of one wheel's four cells
    // Wheels that answer unlike show in the other pattern too: half as much where one does three times as
    // much as the other.
    static constexpr double kClear = 2;
    // Of what slows a turn, by so much less one way round than the other it looks like a wrong sign; and
    // where one is wrong, what the file calls straight on is the turn, and it looks like none.
    static constexpr double kUnlikeTurns = 0.05;

    struct Value {
        double value, error;
    };
    // Of one direction of the wheel.
    double more_in_turn(std::size_t wheel, bool forward) const {
        return means_[1][wheel][forward].mean() - means_[0][wheel][forward].mean();
    }
    struct Patterns {
        double filed, mirrored, error;
        double friction, scrub;  // what slows straight on, and a turn more than that
        double sure;             // by so many errors a pattern has to stand out
    };
    double sure() const { return by_four() ? kSureByFour : kSure; }
    static Mirror judge(const Patterns& seen) {
        const double filed = std::abs(seen.filed), mirrored = std::abs(seen.mirrored);
        const double sure = seen.sure * seen.error;
        const double turns = kUnlikeTurns * (seen.friction + std::max(seen.scrub, 0.0));
        // the scrub's error is half of a pattern's
        const bool straight_is_slower = seen.scrub < -sure / 2;
        const double straight = straight_is_slower ? kUnlikeTurns * seen.friction : 0;
        if (filed > std::max({sure, kClear * mirrored, straight})) return Mirror::as_filed;
        return mirrored > std::max({sure, kClear * filed, turns}) ? Mirror::mirrored : Mirror::unknown;
    }
    bool by_four() const {
        const auto& [left, right] = means_[1];
        return std::min({left[0].count(), left[1].count(), right[0].count(), right[1].count()}) >= 4;
    }
    Patterns patterns() const {
        const Value left = more_in_turn(0), right = more_in_turn(1);
        return {left.value + right.value,
                left.value - right.value,
                std::sqrt(left.error * left.error + right.error * right.error),
                friction_m_per_s2(),
                scrub_m_per_s2(),
                sure()};
    }
    // Of both directions.
    Value more_in_turn(std::size_t wheel) const {
        double variance = 0;
        for (const auto& motion : means_)
            for (const Mean& direction : motion[wheel]) variance += direction.error() * direction.error();
        return {(more_in_turn(wheel, false) + more_in_turn(wheel, true)) / 2, std::sqrt(variance) / 2};
    }
    double scrub_m_per_s2() const {
        double sum = 0;
        for (const std::size_t wheel : {0, 1}) sum += more_in_turn(wheel, false) - more_in_turn(wheel, true);
        return sum / 4;
    }

    std::array<std::array<std::array<Mean, 2>, 2>, 2> means_{};  // straight on, turning; wheel; back, forward
};

}  // namespace wheelwright::ident
