#include "tools/gap_trials/hidden/ode_plant.hpp"

#include <ode/ode.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <mutex>
#include <stdexcept>
#include <string_view>

namespace wheelwright::hidden {
namespace {

constexpr double kGravity_m_per_s2 = 9.81;
// Contacts sink in by this much, and so they stay. A wheel rolls on its whole radius nevertheless.
constexpr double kSink_m = 2e-5;
constexpr double kCastorRadius_m = 0.03;
// Two tyres on one axle both hold it sideways; without some give the engine could not tell how they share the
// force.
constexpr double kSidewaysSlip_m_per_s_N = 1e-7;
constexpr double kSettling_s = 0.25;
constexpr double kTurning_rad_per_s = 1e-3;

// What the engine complained of in this thread. It would print and go on.
thread_local long complaints = 0;

void count_complaint(int, const char*, va_list) { ++complaints; }

void prepare_engine() {
    static std::once_flag once;
    std::call_once(once, [] {
        dInitODE2(0);
        dSetMessageHandler(count_complaint);
    });
    thread_local const bool kReady = dAllocateODEDataForThread(dAllocateMaskAll) != 0;
    if (!kReady) throw std::runtime_error("the Open Dynamics Engine gives this thread no memory");
}

class OdePlant final : public Plant {
  public:
    OdePlant(const Robot& robot, const HiddenSet& hidden)
        : robot_(robot),
          viscous_(hidden.find("viscous_friction")),
          coulomb_(hidden.find("coulomb_friction")),
          stribeck_(hidden.find("stribeck_friction")),
          drag_(hidden.find("quadratic_drag")),
          scrub_(hidden.find("turning_scrub")),
          castor_(hidden.find("castor_drag")),
          slip_(hidden.find("wheel_slip")),
          payload_(hidden.find("payload_step")) {
        if (const HiddenEffect* slope = hidden.find("slope")) {
            slope_angle_rad_ = (*slope)["angle_rad"];
            uphill_rad_ = (*slope)["uphill_rad"];
        }
        if (const HiddenEffect* lateral = hidden.find("cog_lateral")) lateral_m_ = (*lateral)["offset_m"];
        double mismatch = 0;
        if (const HiddenEffect* radius = hidden.find("wheel_radius_mismatch"))
            mismatch = (*radius)["relative"];
        radius_m_[0] = 2 * robot.wheel_radius_m / (2 + mismatch);
        radius_m_[1] = radius_m_[0] * (1 + mismatch);
        if (const HiddenEffect* backlash = hidden.find("backlash")) {
            motor_inertia_kg_m2_ = (*backlash)["motor_inertia_kg_m2"];
        }
        prepare_engine();
        world_ = dWorldCreate();
        // The engine's own one is shared by all worlds and not made for two threads.
        jobs_ = dThreadingAllocateSelfThreadedImplementation();
        dWorldSetStepThreadingImplementation(world_, dThreadingImplementationGetFunctions(jobs_), jobs_);
        contacts_ = dJointGroupCreate(0);
        dWorldSetContactSurfaceLayer(world_, kSink_m);
        // The engine's usual damping of small motions would be a hidden effect of its own.
        dWorldSetAutoDisableFlag(world_, 0);
        dWorldSetLinearDamping(world_, 0);
        dWorldSetAngularDamping(world_, 0);
        ground_ = dCreatePlane(nullptr, 0, 0, 1, kSink_m);
        build_body();
        build_wheel(0);
        build_wheel(1);
        build_castor();
        build_scrub();
        const double tilt = kGravity_m_per_s2 * std::sin(slope_angle_rad_);
        dWorldSetGravity(world_, -tilt * std::cos(uphill_rad_), -tilt * std::sin(uphill_rad_),
                         -kGravity_m_per_s2 * std::cos(slope_angle_rad_));
        settle();
    }

    ~OdePlant() override {
        dGeomDestroy(ground_);
        for (const dGeomID wheel : wheel_geom_) dGeomDestroy(wheel);
        dGeomDestroy(castor_geom_);
        dJointGroupDestroy(contacts_);
        dWorldDestroy(world_);
        dThreadingFreeImplementation(jobs_);
    }

    OdePlant(const OdePlant&) = delete;
    OdePlant& operator=(const OdePlant&) = delete;

    PlantState state() const override {
        PlantState s;
        s.wheel_speed_rad_per_s = {speed(0), speed(1)};
        s.wheel_angle_rad = {angle_rad_[0], angle_rad_[1]};
        const auto forward = direction();
        dVector3 velocity;
        dBodyGetRelPointVel(body_, -cog_ahead_m_, -cog_left_m_, 0, velocity);
        s.speed_m_per_s = forward[0] * velocity[0] + forward[1] * velocity[1];
        s.yaw_rate_rad_per_s = dBodyGetAngularVel(body_)[2];
        s.heading_rad = heading_rad_;
        dVector3 axle;
        dBodyGetRelPointPos(body_, -cog_ahead_m_, -cog_left_m_, 0, axle);
        s.x_m = axle[0];
        s.y_m = axle[1];
        s.height_m = axle[2];
        return s;
    }

    double kinetic_energy_J() const override {
        double energy = 0;
        for (const dBodyID body : {body_, wheel_[0], wheel_[1]}) energy += kinetic_energy_of(body);
        return energy;
    }

    void advance(double step_s, const Pair& torque_Nm) override {
        if (payload_ != nullptr && !loaded_ && time_s_ >= (*payload_)["time_s"] - step_s / 2) load();
        ++steps_;
        apply_friction();
        apply_forces();
        dJointAddHingeTorque(hinge_[0], torque_Nm.left);
        dJointAddHingeTorque(hinge_[1], torque_Nm.right);
        move(step_s);
        time_s_ += step_s;
    }

    double effect_rms_Nm(std::string_view effect) const override {
        double squares = 0;
        if (effect == "viscous_friction") squares = viscous_squares_;
        if (effect == "coulomb_friction") squares = coulomb_squares_;
        if (effect == "stribeck_friction") squares = stribeck_squares_;
        if (effect == "quadratic_drag") squares = drag_squares_;
        if (effect == "turning_scrub") squares = scrub_squares_;
        if (effect == "castor_drag") squares = castor_squares_;
        return steps_ == 0 ? 0 : std::sqrt(squares / (2 * steps_));
    }
    long complaints() const override { return hidden::complaints - complaints_before_; }
    double slipped_m() const override { return slipped_m_; }
    double travelled_m() const override { return travelled_m_; }

  private:
    void build_body() {
        // The whole robot's mass, centre and inertia less those of the wheels.
        const double wheels_kg = 2 * robot_.wheel_mass_kg;
        const double mass = robot_.mass_kg - wheels_kg;
        const double r = robot_.wheel_radius_m;
        cog_ahead_m_ = robot_.mass_kg * robot_.cog_ahead_m / mass;
        cog_left_m_ = robot_.mass_kg * lateral_m_ / mass;
        const double height = (robot_.mass_kg * robot_.cog_height_m - wheels_kg * r) / mass;
        cog_below_axle_m_ = r - height;
        const double half_m = robot_.track_m / 2;
        const double x = cog_ahead_m_ - robot_.cog_ahead_m;
        const double y = cog_left_m_ - lateral_m_;
        const double wheels_about_cog =
            2 * (wheel_inertia() +
                 robot_.wheel_mass_kg *
                     (half_m * half_m + robot_.cog_ahead_m * robot_.cog_ahead_m + lateral_m_ * lateral_m_));
        const double inertia = robot_.yaw_inertia_kg_m2 - mass * (x * x + y * y) - wheels_about_cog;
        if (!(inertia > 0) || !(mass > 0)) throw std::runtime_error("the wheels are heavier than the robot");
        body_ = make_body(mass, 0.6 * inertia, 0.6 * inertia, inertia);
        dBodySetPosition(body_, cog_ahead_m_, cog_left_m_, height);
    }

    // The same about every axis: the engine's gyroscopic term, which is of first order and brakes, then is
    // zero.
    double wheel_inertia() const { return robot_.wheel_inertia_kg_m2 - motor_inertia_kg_m2_; }

    dBodyID make_body(double mass_kg, double ixx, double iyy, double izz) {
        const dBodyID body = dBodyCreate(world_);
        dMass mass;
        dMassSetParameters(&mass, mass_kg, 0, 0, 0, ixx, iyy, izz, 0, 0, 0);
        dBodySetMass(body, &mass);
        return body;
    }

    void build_wheel(std::size_t side) {
        const double inertia = wheel_inertia();
        if (!(inertia > 0)) throw std::runtime_error("the motor's inertia is larger than the whole wheel's");
        wheel_[side] = make_body(robot_.wheel_mass_kg, inertia, inertia, inertia);
        dBodySetFiniteRotationMode(wheel_[side], 1);
        dBodySetFiniteRotationAxis(wheel_[side], 0, 0, 0);
        const double y = (side == 0 ? 0.5 : -0.5) * robot_.track_m;
        dBodySetPosition(wheel_[side], 0, y, robot_.wheel_radius_m);
        hinge_[side] = dJointCreateHinge(world_, nullptr);
        dJointAttach(hinge_[side], wheel_[side], body_);
        dJointSetHingeAnchor(hinge_[side], 0, y, robot_.wheel_radius_m);
        dJointSetHingeAxis(hinge_[side], 0, 1, 0);
        wheel_geom_[side] = dCreateSphere(nullptr, radius_m_[side]);
        dGeomSetBody(wheel_geom_[side], wheel_[side]);
    }

    void build_castor() {
        castor_geom_ = dCreateSphere(nullptr, kCastorRadius_m);
        if (castor_ == nullptr) {
            dGeomSetBody(castor_geom_, body_);
            dGeomSetOffsetPosition(castor_geom_, robot_.castor_ahead_m - cog_ahead_m_, -cog_left_m_,
                                   kCastorRadius_m - robot_.wheel_radius_m + cog_below_axle_m_);
            return;
        }
        const double arm = (*castor_)["arm_m"];
        const double trail = (*castor_)["trail_m"];
        const dBodyID fork = make_body(0.10, 4e-5, 4e-5, 4e-5);
        castor_wheel_ = make_body(0.10, 4e-5, 4e-5, 4e-5);
        dBodySetPosition(fork, arm, 0, 2 * kCastorRadius_m);
        dBodySetPosition(castor_wheel_, arm - trail, 0, kCastorRadius_m);
        swivel_ = dJointCreateHinge(world_, nullptr);
        dJointAttach(swivel_, fork, body_);
        dJointSetHingeAnchor(swivel_, arm, 0, 2 * kCastorRadius_m);
        dJointSetHingeAxis(swivel_, 0, 0, 1);
        dJointSetHingeParam(swivel_, dParamVel, 0);
        dJointSetHingeParam(swivel_, dParamFMax, (*castor_)["swivel_Nm"]);
        dJointSetFeedback(swivel_, &castor_force_);
        const dJointID axle = dJointCreateHinge(world_, nullptr);
        dJointAttach(axle, castor_wheel_, fork);
        dJointSetHingeAnchor(axle, arm - trail, 0, kCastorRadius_m);
        dJointSetHingeAxis(axle, 0, 1, 0);
        dJointSetHingeParam(axle, dParamVel, 0);
        dJointSetHingeParam(axle, dParamFMax, (*castor_)["rolling_N"] * kCastorRadius_m);
        dGeomSetBody(castor_geom_, castor_wheel_);
    }

    void build_scrub() {
        if (scrub_ == nullptr) return;
        const dJointID ground = dJointCreateAMotor(world_, nullptr);
        dJointAttach(ground, body_, nullptr);
        dJointSetAMotorNumAxes(ground, 1);
        dJointSetAMotorAxis(ground, 0, 0, 0, 0, 1);
        dJointSetAMotorParam(ground, dParamVel, 0);
        dJointSetAMotorParam(ground, dParamFMax, (*scrub_)["scrub_Nm"]);
    }

    // Sinks into its contacts with the brakes on.
    void settle() {
        for (const dJointID hinge : hinge_) {
            dJointSetHingeParam(hinge, dParamVel, 0);
            dJointSetHingeParam(hinge, dParamFMax, 1e3);
        }
        constexpr double kStep_s = 5e-4;
        for (double t = 0; t < kSettling_s; t += kStep_s) move(kStep_s);
        for (const dJointID hinge : hinge_) dJointSetHingeParam(hinge, dParamFMax, 0);
        angle_rad_ = {};
        slipped_m_ = travelled_m_ = heading_rad_ = 0;
    }

    void load() {
        loaded_ = true;
        const double mass = (*payload_)["mass_kg"];
        const double inertia = (*payload_)["inertia_kg_m2"];
        const dBodyID load = make_body(mass, 0.6 * inertia, 0.6 * inertia, inertia);
        const double x = robot_.cog_ahead_m - cog_ahead_m_;
        const double y = lateral_m_ - cog_left_m_;
        const double z = robot_.cog_height_m - (robot_.wheel_radius_m - cog_below_axle_m_);
        dVector3 place;
        dVector3 velocity;
        dBodyGetRelPointPos(body_, x, y, z, place);
        dBodyGetRelPointVel(body_, x, y, z, velocity);
        dBodySetPosition(load, place[0], place[1], place[2]);
        dBodySetQuaternion(load, dBodyGetQuaternion(body_));
        dBodySetLinearVel(load, velocity[0], velocity[1], velocity[2]);
        const dReal* turn = dBodyGetAngularVel(body_);
        dBodySetAngularVel(load, turn[0], turn[1], turn[2]);
        const dJointID strap = dJointCreateFixed(world_, nullptr);
        dJointAttach(strap, load, body_);
        dJointSetFixed(strap);
    }

    void apply_friction() {
        const std::array<double, 2> speeds{speed(0), speed(1)};
        for (std::size_t side = 0; side < 2; ++side) {
            if (viscous_ != nullptr) {
                const double torque =
                    -(*viscous_)[side == 0 ? "left_Nm_s_per_rad" : "right_Nm_s_per_rad"] * speeds[side];
                dJointAddHingeTorque(hinge_[side], torque);
                viscous_squares_ += torque * torque;
            }
            double dry = 0;
            if (coulomb_ != nullptr) {
                dry += (*coulomb_)[side == 0 ? "left_Nm" : "right_Nm"];
                if (std::abs(speeds[side]) > kTurning_rad_per_s) coulomb_squares_ += dry * dry;
            }
            if (stribeck_ != nullptr) {
                const double ratio = speeds[side] / (*stribeck_)["stribeck_rad_per_s"];
                const double coulomb = (*stribeck_)["coulomb_Nm"];
                const double torque =
                    coulomb + ((*stribeck_)["static_Nm"] - coulomb) * std::exp(-ratio * ratio);
                dry += torque;
                if (std::abs(speeds[side]) > kTurning_rad_per_s) stribeck_squares_ += torque * torque;
            }
            if (dry > 0) {
                dJointSetHingeParam(hinge_[side], dParamVel, 0);
                // Two limits that are reached at once are a tie that the engine's solver stumbles over.
                const double apart = 1 + 1e-6 * static_cast<double>(side);
                dJointSetHingeParam(hinge_[side], dParamFMax, dry * apart);
            }
        }
    }

    void apply_forces() {
        if (drag_ == nullptr && scrub_ == nullptr && castor_ == nullptr) return;
        const PlantState now = state();
        const auto forward = direction();
        if (drag_ != nullptr) {
            const double force =
                -(*drag_)["drag_N_s2_per_m2"] * now.speed_m_per_s * std::abs(now.speed_m_per_s);
            dVector3 axle;
            dBodyGetRelPointPos(body_, -cog_ahead_m_, -cog_left_m_, 0, axle);
            dBodyAddForceAtPos(body_, force * forward[0], force * forward[1], 0, axle[0], axle[1], axle[2]);
            add_squares(force, 0, drag_squares_);
        }
        if (scrub_ != nullptr && std::abs(now.yaw_rate_rad_per_s) > 1e-3) {
            add_squares(0, (*scrub_)["scrub_Nm"], scrub_squares_);
        }
        if (castor_ != nullptr) {
            // of the last step: what the fork did to the body, about the middle of the axle
            const double ahead = forward[0] * castor_force_.f2[0] + forward[1] * castor_force_.f2[1];
            const double left = forward[0] * castor_force_.f2[1] - forward[1] * castor_force_.f2[0];
            add_squares(ahead, left * cog_ahead_m_ - ahead * cog_left_m_ + castor_force_.t2[2],
                        castor_squares_);
        }
    }

    // A force along the robot and a moment about the vertical, as wheel torques.
    void add_squares(double force_N, double moment_Nm, double& squares) const {
        const double common = force_N * robot_.wheel_radius_m / 2;
        const double difference = moment_Nm * robot_.wheel_radius_m / robot_.track_m;
        squares += (common - difference) * (common - difference);
        squares += (common + difference) * (common + difference);
    }

    void move(double step_s) {
        const auto forward = direction();
        touch(wheel_geom_[0], wheel_[0], forward);
        touch(wheel_geom_[1], wheel_[1], forward);
        touch_castor();
        dWorldStep(world_, step_s);
        dJointGroupEmpty(contacts_);
        for (std::size_t side = 0; side < 2; ++side) {
            angle_rad_[side] += speed(side) * step_s;
            const double rolled = radius_m_[side] * speed(side);
            travelled_m_ += std::abs(rolled) * step_s;
            if (slip_ != nullptr) slipped_m_ += std::abs(slip_m_per_s(side)) * step_s;
        }
        heading_rad_ += dBodyGetAngularVel(body_)[2] * step_s;
    }

    // Speed of the tyre over the ground at the contact, along the rolling direction.
    double slip_m_per_s(std::size_t side) const {
        const auto forward = direction();
        const dReal* place = dBodyGetPosition(wheel_[side]);
        dVector3 v;
        dBodyGetPointVel(wheel_[side], place[0], place[1], place[2] - radius_m_[side], v);
        return forward[0] * v[0] + forward[1] * v[1];
    }

    void touch(dGeomID wheel, dBodyID body, const std::array<double, 2>& forward) {
        dContact contact{};
        if (dCollide(wheel, ground_, 1, &contact.geom, sizeof(dContactGeom)) == 0) return;
        contact.fdir1[0] = forward[0];
        contact.fdir1[1] = forward[1];
        contact.surface.mode = dContactFDir1 | dContactMu2 | dContactSlip2;
        contact.surface.slip2 = kSidewaysSlip_m_per_s_N;
        contact.surface.mu = dInfinity;
        contact.surface.mu2 = dInfinity;
        if (slip_ != nullptr) {
            const double coefficient = (*slip_)["friction_coefficient"];
            contact.surface.mode |= dContactApprox1_1 | dContactSlip1;
            contact.surface.mu = coefficient;
            // the engine's slip: speed per force; the load is what gravity gives, as the step's is not known
            // yet
            contact.surface.slip1 = (*slip_)["slip_speed_m_per_s"] / (coefficient * static_load_N());
        }
        dJointAttach(dJointCreateContact(world_, contacts_, &contact), body, nullptr);
    }

    void touch_castor() {
        dContact contact{};
        if (dCollide(castor_geom_, ground_, 1, &contact.geom, sizeof(dContactGeom)) == 0) return;
        contact.surface.mode = 0;
        contact.surface.mu = castor_ != nullptr ? dInfinity : 0;
        dJointAttach(dJointCreateContact(world_, contacts_, &contact),
                     castor_ != nullptr ? castor_wheel_ : body_, nullptr);
    }

    double static_load_N() const {
        return robot_.mass_kg * kGravity_m_per_s2 * (1 - robot_.cog_ahead_m / robot_.castor_ahead_m) / 2;
    }

    double speed(std::size_t side) const { return dJointGetHingeAngleRate(hinge_[side]); }

    std::array<double, 2> direction() const {
        dVector3 forward;
        dBodyVectorToWorld(body_, 1, 0, 0, forward);
        const double length = std::hypot(forward[0], forward[1]);
        return {forward[0] / length, forward[1] / length};
    }

    static double kinetic_energy_of(dBodyID body) {
        dMass mass;
        dBodyGetMass(body, &mass);
        const dReal* v = dBodyGetLinearVel(body);
        const dReal* w = dBodyGetAngularVel(body);
        dVector3 local;
        dBodyVectorFromWorld(body, w[0], w[1], w[2], local);
        double energy = mass.mass * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        for (std::size_t i = 0; i < 3; ++i) energy += mass.I[5 * i] * local[i] * local[i];
        return energy / 2;
    }

    Robot robot_;
    const HiddenEffect* viscous_;
    const HiddenEffect* coulomb_;
    const HiddenEffect* stribeck_;
    const HiddenEffect* drag_;
    const HiddenEffect* scrub_;
    const HiddenEffect* castor_;
    const HiddenEffect* slip_;
    const HiddenEffect* payload_;
    double slope_angle_rad_ = 0;
    double uphill_rad_ = 0;
    double lateral_m_ = 0;
    double motor_inertia_kg_m2_ = 0;
    std::array<double, 2> radius_m_{};

    dWorldID world_ = nullptr;
    dThreadingImplementationID jobs_ = nullptr;
    dJointGroupID contacts_ = nullptr;
    dGeomID ground_ = nullptr;
    dBodyID body_ = nullptr;
    std::array<dBodyID, 2> wheel_{};
    std::array<dJointID, 2> hinge_{};
    std::array<dGeomID, 2> wheel_geom_{};
    dGeomID castor_geom_ = nullptr;
    dBodyID castor_wheel_ = nullptr;
    dJointID swivel_ = nullptr;
    dJointFeedback castor_force_{};
    double cog_ahead_m_ = 0;  // the body's own, against the axle
    double cog_left_m_ = 0;
    double cog_below_axle_m_ = 0;

    long complaints_before_ = hidden::complaints;
    double time_s_ = 0;
    bool loaded_ = false;
    std::array<double, 2> angle_rad_{};
    double heading_rad_ = 0;
    double slipped_m_ = 0;
    double travelled_m_ = 0;
    double viscous_squares_ = 0, coulomb_squares_ = 0, stribeck_squares_ = 0;
    double drag_squares_ = 0, scrub_squares_ = 0, castor_squares_ = 0;
    double steps_ = 0;
};

}  // namespace

std::unique_ptr<Plant> make_ode_plant(const Robot& robot, const HiddenSet& hidden) {
    return std::make_unique<OdePlant>(robot, hidden);
}

}  // namespace wheelwright::hidden
