// Whether the encoders can be believed: a wheel whose angle does not change by a single digit although the
// torque says that it must have turned has an encoder that is frozen. (Within a count a drive's loop goes on
// at its last speed, with no encoder behind it: that is no change.) (A wheel that stands still against
// something turns back and forth by counts as its torque changes; what does not even do that for long is
// called implausible as well, and stopped.)
//
// Per wheel, from its last change of angle on, the angle it must have gone unseen is integrated: from the
// speed it had, and from the acceleration by the torque beyond what can be held without moving: friction, and
// a slope's share, which is what accelerated this wheel, beside the model, while it turned, or the other one
// lately. Nobody holds nearly the whole torque limit. A torque against its motion may brake the wheel by half
// more than the whole limit would. Too much unseen is one and a half steps of the coarsest encoder, or half
// of that for a wheel that stood, where this encoder's own steps allow. Where no model is known yet, it is
// time.
//
// Where friction is known and the floor is level, in an identification, both ends of what the speed and the
// angle can be are followed: by the torques that were asked, friction of half more or less than the known
// one, and what mass and inertia hand on from the other wheel. What would have shown by now is left out. The
// wheel lies when no such motion stays within this encoder's steps.
//
// And whether they tell the way: the speed that torque and inertia make of a wheel's, over some tens of
// milliseconds, against the one that is measured. A measured one that is the mirror image, or the other
// wheel's, is a lie; so is a yaw rate or a speed that long gains against its torques, and one that leaps to a
// part of itself and from then on gains that part of what it should. See mirrored(). An identification pushes
// beyond friction on purpose, and gently: there, where friction is known, a wheel that goes against the push
// while the other one goes with it is enough.
//
// One thread; no allocation. update(): about 100 instructions while the wheels turn.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/control/velocity_loop_speed.hpp"
#include "firmware/control/wheel_observer.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::control {

inline constexpr Real kNearlyAllTorque = Real(0.75);  // of the torque limit

struct EncoderWatchSettings {
    Real torque_limit_Nm{};
    Real held_Nm{};  // friction may hold it without motion
    Real creeping_rad_per_s{};
    int span_cycles{};         // the observer follows within some of these
    Real full_impulse_Ns{};    // of both rims by full torque, in one span
    Real known_friction_Nm{};  // of a wheel, no less than it is; 0: not known, or there may be a slope
    Real unseen_from_rest_rad = Real(kMostUnseen_rad);  // that a wheel which stood may turn
    int report_cycles = 1;                              // from one report of an encoder to the next
    Real held_unknown_Nm = held_Nm;                     // where no model tells what a slope does
};

// `identifying`: for an identification. Its floor is level, so friction alone may hold a wheel; and its
// torques are gentle, so a gain of speed is looked at for longer.
EncoderWatchSettings encoder_watch_settings(const model::RobotParameters& from, bool identifying);

class EncoderWatch {
  public:
    void configure(const EncoderWatchSettings& settings);

    // Nothing drives: forgets, the wheels may be anywhere.
    void rest(const std::array<EncoderAngle, 2>& told);

    // A cycle in which torques were sent.
    // `model_known`: the plant's K7 and K8 are no guess. True: an encoder is not to be believed.
    bool update(Real elapsed_s, const std::array<EncoderAngle, 2>& told, const WheelObserver<Real>& observer,
                const WheelPair<Real>& torque_Nm, const PlantModel<Real>& plant, bool model_known);

    // Where the cycle has time for it, after update(): about 200 instructions once in a span. True: then.
    bool look(const WheelPair<Real>& speed_rad_per_s, const PlantModel<Real>& plant) {
        if (cycles_ < settings_.span_cycles) return false;
        mirrored_ = mirrored(speed_rad_per_s, plant);
        return true;
    }

  private:
    struct Range {
        Real least = 0, most = 0;
    };
    struct Motion {
        Real speed_rad_per_s = 0;
        Real unexplained_rad_per_s2 = 0;
        Real changed_rad_per_s = 0;  // since, at most
    };
    struct Unseen {  // since the angle last changed
        Range speed_rad_per_s{};
        Range angle_rad{};
        Real time_s{};
        int frames = -1;  // with the same angle
        bool from_rest{};
        int pushed_cycles{};
    };
    struct Wheel {
        EncoderAngle told;  // when it changed last, and in the frames after that
        Unseen unseen;
        Motion before, lately;  // one to two histories ago, and up to one; of reports that changed the angle
        int history_age = 0;
    };
    struct Instant {
        WheelPair<Real> speed_rad_per_s;
        WheelPair<Real> expected_rad_per_s;  // gained by the model since the watch began
    };
    struct Pushed {  // a wheel
        Real torque_Nm = 0;
        Real holds_Nm = 0;           // a body that turns
        Range other_Nm;              // of the other wheel's torque, what accelerates it
        Real beside_rad_per_s2 = 0;  // what the other wheel has gained lately beside the model
    };
    struct Leapt {  // a wheel's speed, and the other one's not
        bool right = false;
        Real should_rad_per_s = 0;  // what torque and inertia have made of it
        Real from_rad_per_s = 0;    // the same when the leap had settled,
        Real told_rad_per_s = 0;    // and what was told then
        int spans = 0, scaled_spans = 0;
    };
    enum class Lie : std::uint8_t { none, left, right, swapped };  // whose
    static constexpr std::size_t kInstants = 8;                    // a power of two

    bool still(Wheel& wheel, const EncoderAngle& told, const Motion& now) const;
    Real beyond_held_Nm(const Wheel& wheel, Real torque_Nm, Real holds_Nm, Real beside_rad_per_s2,
                        Real gain_rad_per_s2) const;
    void remember_changes(Real elapsed_s, const WheelPair<Real>& torque_Nm, const PlantModel<Real>& plant);
    void push_on(Range& speed_rad_per_s, const Pushed& pushed, Real coupling, Real gain_rad_per_s) const;
    bool hidden(Wheel& wheel, Real elapsed_s, const Pushed& pushed, Real radius_m,
                const PlantModel<Real>& plant, bool model_known) const;
    [[gnu::noinline]] bool mirrored(const WheelPair<Real>& speed_rad_per_s, const PlantModel<Real>& plant);
    Real by_unknown_body(const WheelPair<Real>& speed_rad_per_s, const model::Geometry<Real>& geometry) const;
    Lie turned_round(const Instant& from, const Instant& to) const;
    bool gains_against(const Instant& from, const Instant& to, Real off_rad_per_s, Real body_rad_per_s);
    bool scaled(const WheelPair<Real>& expected);
    [[gnu::noinline]] void leap();
    bool against(std::size_t wheel, const WheelPair<Real>& expected, const WheelPair<Real>& told,
                 Real least_rad_per_s);
    [[gnu::noinline]] void push(Real elapsed_s, const WheelPair<Real>& torque_Nm,
                                const PlantModel<Real>& plant);
    [[gnu::noinline]] bool against_push(const WheelPair<Real>& speed_rad_per_s, const WheelPair<Real>& told,
                                        const PlantModel<Real>& plant);

    EncoderWatchSettings settings_;
    int history_reports_ = 0;  // after which a speed is a former one
    std::array<Wheel, 2> wheels_;
    WheelPair<Real> expected_rad_per_s_;
    std::array<Instant, kInstants> instants_;
    std::size_t newest_ = 0;
    int instants_known_ = 0;
    Real full_rad_per_s_ = 0;        // what full torque on both wheels makes of a wheel's speed in a span
    Real unexpected_rad_per_s_ = 0;  // in a span, on average: noise, and what the model does not know
    int spans_averaged_ = 0;
    Leapt leapt_;
    bool leaps_ = false;
    std::array<int, 2> against_cycles_{};
    int turns_against_spans_ = 0, goes_against_spans_ = 0;
    // What the torques alone would have made of the speeds in the span, and its length.
    WheelPair<Real> push_rad_per_s_;
    Real push_s_ = 0;
    std::array<int, 2> against_push_cycles_{};
    int span_cycles_ = 0;  // that the last span took
    bool mirrored_ = false;
    int cycles_ = 0;  // since the newest
};

}  // namespace wheelwright::control
