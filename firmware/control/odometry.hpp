// Where the robot is: dead reckoning from the wheels' angles by exact arcs, and its fusion with poses
// measured from outside.
//
// Fusion is an extended Kalman filter with six states: pose (x, y, heading) and, where calibration is on,
// three constants of the odometry: relative error of distance, relative error of turns, and turn per distance
// (unequal wheels):
//   distance = (1 + a) d,   turn = (1 + b) dtheta + c d
// Covariance is moved on only when a pose arrives or the robot has gone some way, by one step over the whole
// window (arc of constant curvature), so an ordinary cycle costs about 290 instructions and a fix about 1200
// more.
//
// A pose that arrives late (settings.delay_s) is compared with the path as it was: dead reckoning keeps a
// history, and fused pose = correction o dead reckoned pose, where only the correction changes.
//
// One thread; no allocation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "firmware/model/dynamics.hpp"
#include "firmware/model/robot_parameters.hpp"

namespace wheelwright::control {

template <typename Real>
struct OdometrySettings {
    Real position_noise_m{};   // standard deviation of an external position, each axis
    Real heading_noise_rad{};  // and heading
    Real delay_s{};            // age of an external pose when it arrives; at most 0.5
    Real gate_sigma{};         // larger innovations are doubted
    Real distance_noise{};     // standard deviation of distance after 1 m, m
    Real turn_noise{};         // standard deviation of heading after 1 rad, rad
    bool calibrate = true;     // estimate the three constants
    Real track_m{};            // what lengths are measured by
};

template <typename Real>
OdometrySettings<Real> odometry_settings(const model::RobotParameters& from) {
    const auto& o = from.odometry;
    OdometrySettings<Real> to;
    to.position_noise_m = Real(o.external_pose_noise_m);
    to.heading_noise_rad = Real(o.external_heading_noise_rad);
    to.delay_s = Real(o.external_pose_delay_s);
    to.gate_sigma = Real(o.gate_sigma);
    to.distance_noise = Real(o.distance_noise_per_m);
    to.turn_noise = Real(o.turn_noise_per_rad);
    to.calibrate = o.calibrate;
    to.track_m = Real(from.geometry.track_m);
    return to;
}

enum class FixOutcome : std::uint8_t {
    none,        // no external pose yet
    first,       // it has set the pose
    fused,       // it has been fused
    doubted,     // beyond the gate; ignored
    relocated,   // doubted too often in a row: the pose was set anew
    not_finite,  // ignored
};

template <typename Real>
struct OdometryCalibration {
    Real distance{};    // a
    Real turn{};        // b
    Real turn_per_m{};  // c, rad/m
};

template <typename Real>
class Odometry {
  public:
    static constexpr int kDoubtsUntilRelocation = 10;

    void configure(const OdometrySettings<Real>& settings) { settings_ = settings; }

    // Sets both poses (a known start); the calibration is kept.
    void set_pose(const Pose<Real>& pose) {
        set_fused(pose);
        bare_ = pose;
        pending_distance_ = 0;
        pending_turn_ = 0;
        pending_count_ = 0;
    }

    // Forgets that an external pose was seen, and what was learned from them; the poses stay.
    void forget() {
        fixes_ = 0;
        doubts_in_a_row_ = 0;
        calibration_ = {};
        covariance_ = {};
        calibration_seeded_ = false;
        last_ = FixOutcome::none;
    }

    // Moves on by what the wheels turned in this cycle (WheelObserver::turned_rad). now_ns: the cycle's
    // instant.
    void advance(const model::Geometry<Real>& geometry, const WheelPair<Real>& turned_rad,
                 std::int64_t now_ns) {
        const Real left = geometry.wheel_radius_m.left * turned_rad.left;
        const Real right = geometry.wheel_radius_m.right * turned_rad.right;
        const Real distance = (right + left) / 2;
        const Real turn = (right - left) / geometry.track_m;
        pending_distance_ += distance;
        pending_turn_ += turn;
        if (++pending_count_ >= kBareEvery) flush_bare();
        const Real true_distance = (1 + calibration_.distance) * distance;
        const Real true_turn = (1 + calibration_.turn) * turn + calibration_.turn_per_m * distance;
        reckoned_ = model::advance_along_arc(reckoned_, true_distance, true_turn);
        window_distance_ += std::abs(true_distance);
        window_turn_ += std::abs(true_turn);
        window_turn_raw_ += turn;
        window_distance_raw_ += distance;
        if (now_ns - history_[history_newest_].time_ns >= kHistoryStep_ns) {
            history_newest_ = (history_newest_ + 1) % kHistory;
            history_[history_newest_] = {now_ns, reckoned_};
        }
        now_ns_ = now_ns;
        fused_ = corrected(reckoned_);
        if (fixes_ > 0 &&
            (window_distance_ > kLongWindowTracks * settings_.track_m || window_turn_ > kLongWindow_rad)) {
            propagate(reckoned_);
        }
    }

    // Takes an external pose that arrived in this cycle. Call after advance().
    FixOutcome fuse(const Pose<Real>& measured) {
        last_ = fuse_one(measured);
        return last_;
    }

    // The best pose there is. Heading is continuous, not wrapped.
    const Pose<Real>& pose() const { return fused_; }
    // Wheels alone, uncalibrated, from the last set_pose() (or the first external pose). At most 8 cycles
    // old.
    const Pose<Real>& bare_pose() const { return bare_; }
    const OdometryCalibration<Real>& calibration() const { return calibration_; }
    // Variance of x, y, heading, and of the calibration, as of the last window's end.
    Real variance(std::size_t state) const { return covariance_[state][state]; }
    FixOutcome last_outcome() const { return last_; }
    std::uint32_t fixes() const { return fixes_; }      // accepted, ever
    std::uint32_t doubted() const { return doubted_; }  // ever
    bool localised() const { return fixes_ > 0; }

  private:
    static constexpr std::size_t kStates = 6;
    static constexpr std::size_t kHistory = 128;
    static constexpr std::int64_t kHistoryStep_ns = 5'000'000;
    static constexpr int kBareEvery = 8;
    // Over a longer window the robot is not taken to drive one arc.
    static constexpr Real kLongWindowTracks = Real(0.8);
    static constexpr Real kLongWindow_rad = Real(0.25);
    // Before any pose: radii and track to 2 %, the wheels' radii alike to 1 % (over the track: turn per
    // metre).
    static constexpr Real kCalibrationSigma = Real(0.02);
    static constexpr Real kUnlikeSigma = Real(0.01);
    static constexpr Real kCalibrationWander = Real(1e-4);  // per square root of a metre
    static constexpr Real kLargestCalibration = Real(0.1);
    static constexpr Real kLargestUnlike = Real(0.03);
    // A distance unsettles the heading like a turn by this, times the distance in tracks.
    static constexpr Real kTurnPerTrack_rad = Real(0.03);
    static constexpr Real kUnmeasuredMotion = Real(0.05);  // of the external noise, for each fix

    struct Past {
        std::int64_t time_ns = 0;
        Pose<Real> pose;
    };

    void flush_bare() {
        bare_ = model::advance_along_arc(bare_, pending_distance_, pending_turn_);
        pending_distance_ = 0;
        pending_turn_ = 0;
        pending_count_ = 0;
    }

    Pose<Real> corrected(const Pose<Real>& reckoned) const {
        return {shift_x_m_ + cos_ * reckoned.x_m - sin_ * reckoned.y_m,
                shift_y_m_ + sin_ * reckoned.x_m + cos_ * reckoned.y_m, reckoned.heading_rad + rotation_rad_};
    }

    // Chooses the correction that takes `reckoned` to `wanted`.
    void correct(const Pose<Real>& reckoned, const Pose<Real>& wanted) {
        rotation_rad_ = wanted.heading_rad - reckoned.heading_rad;
        cos_ = std::cos(rotation_rad_);
        sin_ = std::sin(rotation_rad_);
        shift_x_m_ = wanted.x_m - (cos_ * reckoned.x_m - sin_ * reckoned.y_m);
        shift_y_m_ = wanted.y_m - (sin_ * reckoned.x_m + cos_ * reckoned.y_m);
    }

    void set_fused(const Pose<Real>& pose) {
        reckoned_ = pose;
        correct(pose, pose);
        fused_ = pose;
        anchor_ = pose;
        history_.fill({0, pose});
        history_newest_ = 0;
        clear_window();
    }

    void clear_window() {
        window_distance_ = 0;
        window_turn_ = 0;
        window_distance_raw_ = 0;
        window_turn_raw_ = 0;
    }

    // The dead-reckoned pose at an earlier time, between history entries by a straight line.
    Pose<Real> reckoned_at(std::int64_t time_ns) const {
        if (time_ns >= now_ns_) return reckoned_;
        // Entries are at least kHistoryStep_ns apart, so this many steps back is early enough.
        const std::int64_t span_ns = history_[history_newest_].time_ns - time_ns;
        const std::int64_t most = span_ns <= 0 ? 0 : (span_ns + kHistoryStep_ns - 1) / kHistoryStep_ns;
        auto back = static_cast<std::size_t>(std::min<std::int64_t>(most, kHistory - 1));
        const auto entry = [this](std::size_t steps) -> const Past& {
            return history_[(history_newest_ + kHistory - steps) % kHistory];
        };
        while (back > 0 && (entry(back).time_ns == 0 || entry(back - 1).time_ns <= time_ns)) --back;
        const Past& earlier = entry(back);
        const Past later = back > 0 ? entry(back - 1) : Past{now_ns_, reckoned_};
        const Real span = static_cast<Real>(later.time_ns - earlier.time_ns);
        const Real share = span > 0 ? static_cast<Real>(time_ns - earlier.time_ns) / span : Real(0);
        const auto mix = [share](Real from, Real to) {
            return from + std::clamp(share, Real(0), Real(1)) * (to - from);
        };
        return {mix(earlier.pose.x_m, later.pose.x_m), mix(earlier.pose.y_m, later.pose.y_m),
                mix(earlier.pose.heading_rad, later.pose.heading_rad)};
    }

    // Moves the covariance over the window from the anchor to `end` (both dead reckoned).
    void propagate(const Pose<Real>& end) {
        const Real rx = end.x_m - anchor_.x_m;
        const Real ry = end.y_m - anchor_.y_m;
        const Real dx = cos_ * rx - sin_ * ry;
        const Real dy = sin_ * rx + cos_ * ry;
        auto& p = covariance_;
        // pose' = F pose + G constants: the heading's error swings the window's chord; a turn error, which
        // grows evenly over the window, swings it half as much.
        const Real tb = window_turn_raw_;
        const Real tc = window_distance_raw_;
        std::array<Real, kStates> r0, r1, r2;  // F P, upper rows
        for (std::size_t j = 0; j < kStates; ++j) {
            const Real swung = p[2][j] + (tb * p[4][j] + tc * p[5][j]) / 2;
            r0[j] = p[0][j] - dy * swung + dx * p[3][j];
            r1[j] = p[1][j] + dx * swung + dy * p[3][j];
            r2[j] = p[2][j] + tb * p[4][j] + tc * p[5][j];
        }
        const auto to_x = [&](const std::array<Real, kStates>& r) {
            return r[0] - dy * (r[2] + (tb * r[4] + tc * r[5]) / 2) + dx * r[3];
        };
        const auto to_y = [&](const std::array<Real, kStates>& r) {
            return r[1] + dx * (r[2] + (tb * r[4] + tc * r[5]) / 2) + dy * r[3];
        };
        const auto to_heading = [&](const std::array<Real, kStates>& r) {
            return r[2] + tb * r[4] + tc * r[5];
        };
        p[0][0] = to_x(r0);
        p[0][1] = p[1][0] = to_y(r0);
        p[0][2] = p[2][0] = to_heading(r0);
        p[1][1] = to_y(r1);
        p[1][2] = p[2][1] = to_heading(r1);
        p[2][2] = to_heading(r2);
        for (std::size_t j = 3; j < kStates; ++j) {
            p[0][j] = p[j][0] = r0[j];
            p[1][j] = p[j][1] = r1[j];
            p[2][j] = p[j][2] = r2[j];
        }
        // Noise: a random walk in distance and in turn, the turn's seen from the window's end.
        const Real along = settings_.distance_noise * settings_.distance_noise * window_distance_;
        const Real turn = settings_.turn_noise * settings_.turn_noise *
                          (window_turn_ + kTurnPerTrack_rad * window_distance_ / settings_.track_m);
        const Real chord = std::max(dx * dx + dy * dy, Real(1e-12));
        p[0][0] += along * dx * dx / chord + turn * dy * dy / 3;
        p[1][1] += along * dy * dy / chord + turn * dx * dx / 3;
        const Real xy = along * dx * dy / chord - turn * dx * dy / 3;
        p[0][1] += xy;
        p[1][0] += xy;
        p[2][2] += turn;
        p[0][2] -= turn * dy / 2;
        p[2][0] -= turn * dy / 2;
        p[1][2] += turn * dx / 2;
        p[2][1] += turn * dx / 2;
        if (settings_.calibrate) {  // tyres and loads change
            const Real wander = kCalibrationWander * kCalibrationWander * window_distance_;
            for (std::size_t i = 3; i < kStates; ++i) p[i][i] += wander;
        }
        anchor_ = end;
        clear_window();
    }

    void seed_covariance() {
        const Real position = settings_.position_noise_m * settings_.position_noise_m;
        const Real heading = settings_.heading_noise_rad * settings_.heading_noise_rad;
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < kStates; ++j) covariance_[i][j] = covariance_[j][i] = 0;
        }
        covariance_[0][0] = covariance_[1][1] = position;
        covariance_[2][2] = heading;
        if (!calibration_seeded_ && settings_.calibrate) {
            covariance_[3][3] = covariance_[4][4] = kCalibrationSigma * kCalibrationSigma;
            covariance_[5][5] = kUnlikeSigma * kUnlikeSigma / (settings_.track_m * settings_.track_m);
            calibration_seeded_ = true;
        }
    }

    FixOutcome fuse_one(const Pose<Real>& measured) {
        if (!std::isfinite(measured.x_m) || !std::isfinite(measured.y_m) ||
            !std::isfinite(measured.heading_rad)) {
            return FixOutcome::not_finite;
        }
        const auto delay_ns = static_cast<std::int64_t>(settings_.delay_s * Real(1e9));
        const Pose<Real> then = reckoned_at(now_ns_ - delay_ns);
        if (fixes_ == 0) {
            relocate(then, measured);
            bare_ = fused_;
            pending_distance_ = 0;
            pending_turn_ = 0;
            pending_count_ = 0;
            return FixOutcome::first;
        }
        propagate(then);
        // A robot that is pushed while its wheels stand must be believed sooner or later.
        for (std::size_t i = 0; i < 3; ++i) {
            const Real step =
                kUnmeasuredMotion * (i < 2 ? settings_.position_noise_m : settings_.heading_noise_rad);
            covariance_[i][i] += step * step;
        }
        const Pose<Real> expected = corrected(then);
        const std::array<Real, 3> innovation{measured.x_m - expected.x_m, measured.y_m - expected.y_m,
                                             wrap_angle_rad(measured.heading_rad - expected.heading_rad)};
        const std::array<Real, 3> noise{settings_.position_noise_m * settings_.position_noise_m,
                                        settings_.position_noise_m * settings_.position_noise_m,
                                        settings_.heading_noise_rad * settings_.heading_noise_rad};
        const Real gate = settings_.gate_sigma * settings_.gate_sigma;
        for (std::size_t i = 0; i < 3; ++i) {
            if (!(innovation[i] * innovation[i] > gate * (covariance_[i][i] + noise[i]))) continue;
            ++doubted_;
            if (++doubts_in_a_row_ < kDoubtsUntilRelocation) return FixOutcome::doubted;
            relocate(then, measured);
            return FixOutcome::relocated;
        }
        doubts_in_a_row_ = 0;
        std::array<Real, kStates> change{};
        // One scalar measurement after another, on the upper triangle.
        fuse_scalar<0>(innovation[0], noise[0], change);
        fuse_scalar<1>(innovation[1], noise[1], change);
        fuse_scalar<2>(innovation[2], noise[2], change);
        for (std::size_t j = 1; j < kStates; ++j) {
            for (std::size_t k = 0; k < j; ++k) covariance_[j][k] = covariance_[k][j];
        }
        correct(then, {expected.x_m + change[0], expected.y_m + change[1], expected.heading_rad + change[2]});
        const auto learn = [](Real& constant, Real by, Real largest) {
            constant = std::clamp(constant + by, -largest, largest);
        };
        learn(calibration_.distance, change[3], kLargestCalibration);
        learn(calibration_.turn, change[4], kLargestCalibration);
        learn(calibration_.turn_per_m, change[5], kLargestUnlike / settings_.track_m);
        fused_ = corrected(reckoned_);
        ++fixes_;
        return FixOutcome::fused;
    }

    // Kalman update by a measurement of state I. Unrolled: a third of the instructions.
    template <std::size_t I>
    void fuse_scalar(Real innovation, Real noise, std::array<Real, kStates>& change) {
        auto& p = covariance_;
        const std::array<Real, kStates> row{p[0][I],
                                            p[std::min<std::size_t>(1, I)][std::max<std::size_t>(1, I)],
                                            p[std::min<std::size_t>(2, I)][std::max<std::size_t>(2, I)],
                                            p[I][3],
                                            p[I][4],
                                            p[I][5]};
        const Real scale = 1 / (row[I] + noise);
        const Real rest = (innovation - change[I]) * scale;
        [&]<std::size_t... J>(std::index_sequence<J...>) {
            ((change[J] += row[J] * rest, subtract_from<J>(p[J], row[J] * scale, row)), ...);
        }(std::make_index_sequence<kStates>{});
    }

    // to[k] -= gain * row[k] for k >= J
    template <std::size_t J>
    static void subtract_from(std::array<Real, kStates>& to, Real gain,
                              const std::array<Real, kStates>& row) {
        [&]<std::size_t... K>(std::index_sequence<K...>) {
            ((to[J + K] -= gain * row[J + K]), ...);
        }(std::make_index_sequence<kStates - J>{});
    }

    void relocate(const Pose<Real>& then, const Pose<Real>& measured) {
        correct(then, measured);
        anchor_ = then;
        clear_window();
        seed_covariance();
        fused_ = corrected(reckoned_);
        doubts_in_a_row_ = 0;
        ++fixes_;
    }

    OdometrySettings<Real> settings_;
    Pose<Real> fused_;
    Pose<Real> bare_;
    Pose<Real> reckoned_;  // calibrated dead reckoning, never corrected
    Pose<Real> anchor_;    // the reckoned pose that covariance_ belongs to
    Real rotation_rad_{};
    Real cos_ = 1;
    Real sin_{};
    Real shift_x_m_{};
    Real shift_y_m_{};
    OdometryCalibration<Real> calibration_;
    std::array<std::array<Real, kStates>, kStates> covariance_{};
    Real window_distance_{};
    Real window_turn_{};
    Real window_distance_raw_{};
    Real window_turn_raw_{};
    Real pending_distance_{};
    Real pending_turn_{};
    int pending_count_ = 0;
    std::array<Past, kHistory> history_{};
    std::size_t history_newest_ = 0;
    std::int64_t now_ns_ = 0;
    std::uint32_t fixes_ = 0;
    std::uint32_t doubted_ = 0;
    int doubts_in_a_row_ = 0;
    bool calibration_seeded_ = false;
    FixOutcome last_ = FixOutcome::none;
};

}  // namespace wheelwright::control
