// Whether the encoders can be believed. Each rule needs what no wheel does, or two witnesses that disagree:
//
//   frozen      the angle does not change by a digit, though the wheel must have gone on: by the speed that
//   it
//               had, by its torque beyond what can be held without moving (friction, and a slope's share), or
//               by the drive's own speed. Too much unseen is one and a half steps of the encoder. Where no
//               model is known, torque counts by its time. While the probe pushes one wheel alone, to find
//               out whether it turns at all, the other one tells: a wheel that is held fast moves no robot.
//   two tongues the drive's speed, of one sign for a while, is not how its angle changes.
//   mirrored    a wheel turns backwards as fast as it turned forwards, much sooner than its torque can turn
//   it. against     a wheel, or the robot's turning, is accelerated against its torque as much as the torque
//   should
//               accelerate it: a sign that is wrong, or wheels that are exchanged.
//
// What is in no frame of a drive is not seen: an encoder that counts some of its counts, in angle and speed
// alike, is a wheel of another radius.
//
// One thread; no allocation. update(): about 300 instructions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "drivers/motor_drive.hpp"
#include "firmware/model/dynamics.hpp"
#include "firmware/model/robot_parameters.hpp"
#include "firmware/model/types.hpp"

namespace wheelwright::task {

// A cycle, as the watch sees it.
struct WheelEvidence {
    double elapsed_s = 0;
    const drivers::DriveFeedback& left;
    const drivers::DriveFeedback& right;
    WheelPair<double> speed_rad_per_s;         // as the observer has it
    WheelPair<double> unexplained_rad_per_s2;  // of the wheels' acceleration, by the observer
    WheelPair<double> sent_torque_Nm;          // in the cycle before
    WheelPair<double> acting_torque_Nm;        // now
    const model::Geometry<double>& geometry;
    const model::Dynamics<double>* dynamics = nullptr;  // nullptr: not known
};

class EncoderWatch {
  public:
    void configure(const model::RobotParameters& parameters);

    // Nothing drives: forgets, the wheels may be anywhere.
    void rest(const WheelEvidence& now);

    // A cycle in which torques were sent. True: an encoder is not to be believed.
    bool update(const WheelEvidence& now);

    // The same where the probe asks the wheels one by one.
    bool update_alone(const WheelEvidence& now);

  private:
    static constexpr std::size_t kRemembered = 32;  // cycles, power of two

    // A speed, and what the torque should have made of it.
    struct Course {
        double speed = 0;     // at the last block's end
        double expected = 0;  // change since then
        double evidence = 0;
    };

    struct Wheel {
        // while the angle stays as it is
        double angle_rad = 0;  // and the torque at its last change
        double torque_Nm = 0;
        double speed = 0;  // unseen, since then
        double unseen_rad = 0;
        bool turned = false;  // it did, and had no time to stop
        std::int64_t told_ns = 0;
        int frames = -1;  // since then, with the same angle
        int pushed_cycles = 0;
        double speed_before = 0, speed_lately = 0;  // 16 to 32 cycles ago, and up to 16
        double unexplained_before = 0, unexplained_lately = 0;
        int history_age = 0;
        // what may be hidden between two of the encoder's steps, as learned
        double step_rad = 0;
        double came_out_rad = 0;
        int coming_out = 0;  // cycles left to see what a stillness has hidden
        // while the drive's speed keeps its sign
        int of_one_sign = 0;
        double last_angle_rad = 0, last_told_speed = 0;
        std::int64_t last_told_ns = 0;
        double beside_rad = 0;  // gone beside what the speed said
        double by_speed_rad = 0;
        double roughness_rad = 0;  // by which angle and speed of a living encoder differ, as learned
        // lately
        std::array<double, kRemembered> angles_rad{}, speeds_rad_per_s{};
        int mirrored_cycles = 0;
        Course course;
    };

    struct Response {
        double forward = 0, turning = 0;  // of a wheel to the torques' sum, to their difference
    };

    bool still(Wheel& wheel, const drivers::DriveFeedback& told, double speed_rad_per_s,
               double unexplained_rad_per_s2, double torque_Nm) const;
    void learn_step(Wheel& wheel, double elapsed_s) const;
    bool pushed_in_vain(Wheel& wheel, double torque_Nm) const;
    bool goes_unseen(Wheel& wheel, double torque_Nm, double other_Nm, double elapsed_s,
                     const Response& response) const;
    bool two_tongues(Wheel& wheel, const drivers::DriveFeedback& told) const;
    bool mirrored(Wheel& wheel, double elapsed_s, const Response& response) const;
    bool against_torque(const WheelEvidence& now, const Response& left, const Response& right);
    bool against(Course& course, double speed, double full_rad_per_s2) const;
    double full_rad_per_s2(const Response& response) const;
    double beyond_held_Nm(const Wheel& wheel, double torque_Nm, double slope_Nm) const;

    double torque_limit_Nm_ = 0;
    double held_Nm_ = 0;  // a wheel that stands may be held by so much,
    double rubs_Nm_ = 0;  // one that turns may be braked by so much
    double creeping_rad_per_s_ = 0;
    std::array<Wheel, 2> wheels_;
    Course turning_;
    std::array<double, 2>
        alone_at_rad_{};  // of a wheel that is pushed alone at its last change, and the other
    int block_cycles_ = 0;
    double block_s_ = 0;
    std::size_t newest_ = 0;  // of what the wheels remember
    std::size_t remembered_ = 0;
};

}  // namespace wheelwright::task
