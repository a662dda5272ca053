// The loop design, judged by experiments on the controllers that run: nothing here knows its formulas.
#include <cmath>
#include <complex>
#include <cstdio>
#include <utility>

#include "tests/control/inner_loop.hpp"

#include <CppUTest/TestHarness.h>

using namespace wheelwright;
using namespace wheelwright::control;

namespace {

// Breaks the loop at the motors: the robot is shaken by a sine of torque, while the observer is told the
// torque that the controller answers with. The ratio of answer to sine, negated, is the open loop at that
// frequency.
std::complex<double> measured_open_loop(const model::RobotParameters& parameters,
                                        double frequency_rad_per_s) {
    bench::Truth truth;
    truth.transport_s = parameters.velocity_loop.actuation_delay_s;
    truth.lag_s = 0;
    truth.encoder_noise_rad = 0;
    truth.filter_rad_per_s = 0;
    truth.quantised = false;
    truth.frame_jitter_s = 0;
    truth.frame_s = 0;
    truth.k5 = 0;
    bench::InnerLoop<double> inner(parameters);
    inner.model.dynamics.k5_m = inner.model.dynamics.k6_per_m = 0;
    bench::Robot robot(truth, 1);
    for (int k = 0; k < 5; ++k) {
        inner.sense(robot);
        inner.observer.torque_sent({});
        robot.cycle(0, 0);
    }
    inner.loop.start(inner.model, inner.observer.motion(), {});
    const double amplitude = 0.05;
    const int periods = static_cast<int>(std::ceil(1.5 * frequency_rad_per_s / (2 * bench::kPi))) + 4;
    const int warm_up = 1500;
    const int cycles = static_cast<int>(std::lround(periods * 2 * bench::kPi / frequency_rad_per_s * 1e3));
    std::complex<double> in, out;
    for (int k = 0; k < warm_up + cycles; ++k) {
        inner.sense(robot);
        const auto answer = inner.loop.update(inner.model, inner.observer.motion(), {});
        inner.observer.torque_sent(answer);
        const double shake = amplitude * std::cos(frequency_rad_per_s * 1e-3 * k);
        robot.cycle(shake, shake);
        if (k >= warm_up) {
            const std::complex<double> turn = std::polar(1.0, -frequency_rad_per_s * 1e-3 * k);
            in += shake * turn;
            out += answer.left * turn;
        }
    }
    return -out / in;
}

}  // namespace

TEST_GROUP(LoopDesign){};

TEST(LoopDesign, MarginsAreThoseMeasuredOnTheRunningLoop) {
    for (const double delay : {1.4e-3, 2.0e-3, 2.7e-3}) {
        auto parameters = bench::notes_robot();
        parameters.velocity_loop.actuation_delay_s = delay;
        LoopDesign<double> design;
        design.run(loop_design_request<double>(parameters, 1e-3));
        CHECK(design.accepted());
        const auto& r = design.result();
        double measured_peak = 0, margin = 180, last_size = 0, last_phase = 0;
        for (double w = 20; w < 700; w *= 1.06) {
            const auto l = measured_open_loop(parameters, w);
            measured_peak = std::max(measured_peak, 1 / std::abs(1.0 + l));
            const double phase = std::arg(-l);
            if (last_size > 1 && std::abs(l) <= 1) {
                const double share = (last_size - 1) / (last_size - std::abs(l));
                margin = std::min(margin, (last_phase + share * (phase - last_phase)) * 180 / bench::kPi);
            }
            last_size = std::abs(l);
            last_phase = phase;
        }
        std::printf(
            "\n  delay %.1f ms: Kp %.1f, Ki %.0f, b %.2f; phase margin %.1f deg (measured %.1f), Ms %.2f "
            "(measured %.2f), "
            "settling %.0f ms, observer's delay at crossover %.1f ms",
            1e3 * delay, r.gains.kp_per_s, r.gains.ki_per_s2, r.gains.setpoint_weight, r.phase_margin_deg,
            margin, r.sensitivity_peak, measured_peak, 1e3 * r.settling_s, 1e3 * r.observer_delay_s);
        DOUBLES_EQUAL(margin, r.phase_margin_deg, 3.0);
        DOUBLES_EQUAL(measured_peak, r.sensitivity_peak, 0.1);
        CHECK(r.phase_margin_deg >= 45 && r.sensitivity_peak <= 2);
    }
    std::printf("\n");
}

TEST(LoopDesign, ThePapersGainsAreThoseOfThePrintAndTheirMarginsAreTold) {
    auto parameters = bench::notes_robot();
    parameters.velocity_loop.method = model::LoopDesignMethod::paper;
    LoopDesign<double> design;
    const auto status = design.run(loop_design_request<double>(parameters, 1e-3));
    const auto& r = design.result();
    std::printf("\n  paper's gains, 2 ms: %s, phase margin %.1f deg, Ms %.2f\n",
                kDesignStatusNames[static_cast<std::size_t>(status)].data(), r.phase_margin_deg,
                r.sensitivity_peak);
    DOUBLES_EQUAL(184.2, r.gains.kp_per_s, 0.1);  // (71) with -ln 0.01 = 4.605 instead of 4.6
    DOUBLES_EQUAL(8483, r.gains.ki_per_s2, 1);
    DOUBLES_EQUAL(1, r.gains.setpoint_weight, 0);
    CHECK(status == DesignStatus::refused_phase_margin);
}

TEST(LoopDesign, WhatCannotHaveItsMarginsIsRefusedByName) {
    auto parameters = bench::notes_robot();
    LoopDesign<double> design;
    parameters.velocity_loop.actuation_delay_s = 12e-3;
    parameters.velocity_loop.settling_time_s = 0.05;
    CHECK(design.run(loop_design_request<double>(parameters, 1e-3)) == DesignStatus::refused_settling);
    parameters = bench::notes_robot();
    parameters.velocity_loop.phase_margin_deg = 60;
    CHECK(design.run(loop_design_request<double>(parameters, 1e-3)) == DesignStatus::refused_phase_margin);
    parameters = bench::notes_robot();
    parameters.velocity_loop.sensitivity_peak = 1.3;
    CHECK(design.run(loop_design_request<double>(parameters, 1e-3)) == DesignStatus::refused_sensitivity);
    // patience makes the long delay possible
    parameters = bench::notes_robot();
    parameters.velocity_loop.actuation_delay_s = 12e-3;
    parameters.velocity_loop.settling_time_s = 0.4;
    CHECK(design.run(loop_design_request<double>(parameters, 1e-3)) == DesignStatus::accepted);
    parameters.velocity_loop.settling_time_s = 5;
    CHECK(design.run(loop_design_request<double>(parameters, 1e-3)) == DesignStatus::accepted);
}

TEST(LoopDesign, ReportsThatComeSeldomAreOlderInTheMean) {
    auto parameters = bench::notes_robot();
    parameters.velocity_loop.settling_time_s = 0;
    parameters.velocity_loop.angle_noise_rad = 0;
    parameters.velocity_loop.actuation_delay_s = 2e-3;
    for (const auto& [period_ms, settling_s] : {std::pair{1, 0.05}, {2, 0.05}, {5, 0.056}, {10, 0.091}}) {
        parameters.drive.encoder_period_ms = period_ms;  // 14 (2 ms + (T - 1 ms) / 2), fifty cycles at least
        DOUBLES_EQUAL(settling_s, velocity_loop_speed(parameters, 1e-3).settling_time_s, 1e-12);
    }
    parameters.velocity_loop.angle_noise_rad = 1e-2;  // by the noise of as many reports: sqrt(T)^0.4
    const double seldom_s = velocity_loop_speed(parameters, 1e-3).settling_time_s;
    parameters.drive.encoder_period_ms = 1;
    DOUBLES_EQUAL(std::pow(10, 0.2), seldom_s / velocity_loop_speed(parameters, 1e-3).settling_time_s, 1e-9);
}

TEST(LoopDesign, StepByStepGivesTheSameAndEnds) {
    const auto request = loop_design_request<double>(bench::notes_robot(), 1e-3);
    LoopDesign<double> whole, pieces;
    whole.run(request);
    pieces.begin(request);
    int steps = 1;
    while (pieces.step()) ++steps;
    std::printf("\n  %d steps\n", steps);
    CHECK(steps < 400);
    CHECK(pieces.status() == whole.status());
    DOUBLES_EQUAL(whole.result().gains.kp_per_s, pieces.result().gains.kp_per_s, 0);
    DOUBLES_EQUAL(whole.result().phase_margin_deg, pieces.result().phase_margin_deg, 0);
    CHECK_FALSE(pieces.step());
}

TEST(LoopDesign, SinglePrecisionFindsTheSameDesign) {
    LoopDesign<double> d;
    LoopDesign<float> f;
    d.run(loop_design_request<double>(bench::notes_robot(), 1e-3));
    f.run(loop_design_request<float>(bench::notes_robot(), 1e-3F));
    CHECK(f.accepted());
    DOUBLES_EQUAL(d.result().gains.kp_per_s, double(f.result().gains.kp_per_s), 8);
    DOUBLES_EQUAL(d.result().phase_margin_deg, double(f.result().phase_margin_deg), 1);
    DOUBLES_EQUAL(d.result().sensitivity_peak, double(f.result().sensitivity_peak), 0.05);
}
