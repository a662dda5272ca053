#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

#include "tools/cli/report.hpp"
#include "tools/logs/raw_log.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::size_t kKeptProblems = 20;
constexpr std::size_t kFewestSamples = 20;
constexpr double kSlowest_Hz = 20;
constexpr double kFastest_Hz = 2000;
constexpr double kRateTolerance = 0.01;
// A step off by more than this share of the usual one is no rounding: a late stamp, or missing rows.
constexpr double kStepTolerance = 0.5;
// Time that goes back by more steps than this has started anew; by less, rows are out of order.
constexpr double kReordered_steps = 10;
// One row that is missing is put between its neighbours, and more of them for so long: a robot's speed
// settles in a tenth of a second and more.
constexpr double kFilled_s = 0.01;
// Stamps on either side of a step that say whether it lasts.
constexpr std::size_t kWitnesses = 5;

using Samples = std::vector<RawSample>;

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

std::string seconds(double value) { return number_text(value, 6) + " s"; }

std::vector<double> steps_of(const Samples& samples) {
    std::vector<double> steps;
    for (std::size_t i = 1; i < samples.size(); ++i) steps.push_back(samples[i].t_s - samples[i - 1].t_s);
    return steps;
}

// Something that happens in several places of a file: one note for all.
struct Happened {
    std::size_t count = 0;
    std::size_t first_line = 0;

    void at(std::size_t line) {
        if (count++ == 0) first_line = line;
    }
};

// From a to b, a share of the way.
RawSample between(const RawSample& a, const RawSample& b, double share) {
    const auto at = [&](double x, double y) { return x + share * (y - x); };
    RawSample m;
    m.t_s = at(a.t_s, b.t_s);
    m.torque_Nm = {at(a.torque_Nm.left, b.torque_Nm.left), at(a.torque_Nm.right, b.torque_Nm.right)};
    m.wheel = {at(a.wheel.left, b.wheel.left), at(a.wheel.right, b.wheel.right)};
    m.gyro = at(a.gyro, b.gyro);
    m.accel_m_per_s2 = at(a.accel_m_per_s2, b.accel_m_per_s2);
    return m;
}

class Segmenter {
  public:
    Segmenter(RawLog raw, MeasuredLogs& logs) : raw_(std::move(raw)), logs_(logs) {}

    void run() {
        if (raw_.samples.size() < kFewestSamples) {
            problem("has " + std::to_string(raw_.samples.size()) + " samples, expected at least " +
                    std::to_string(kFewestSamples));
            return;
        }
        usual_step_s_ = median(steps_of(raw_.samples));
        if (!(usual_step_s_ > 0)) {
            problem("time stands still or goes back in most rows, expected it to grow");
            return;
        }
        if (1 / usual_step_s_ < kSlowest_Hz * (1 - kRateTolerance) ||
            1 / usual_step_s_ > kFastest_Hz * (1 + kRateTolerance)) {
            problem("is sampled every " + seconds(usual_step_s_) + ", expected 20 to 2000 samples a second");
            return;
        }
        for (Samples& part : restarts()) {
            put_in_order(part);
            cut_at_gaps(part);
        }
        finish();
    }

  private:
    std::string of_run(const std::string& text) const {
        return raw_.run.empty() ? text : raw_.run + ": " + text;
    }
    void problem(const std::string& text) { logs_.problem(0, of_run(text)); }
    void note(const Happened& happened, const std::string& text) {
        if (happened.count > 0) logs_.note(happened.first_line, of_run(text));
    }

    std::vector<Samples> restarts() {
        std::vector<Samples> parts(1);
        for (const RawSample& sample : raw_.samples) {
            if (!parts.back().empty() &&
                sample.t_s < parts.back().back().t_s - kReordered_steps * usual_step_s_) {
                restarted_.at(sample.line);
                parts.emplace_back();
            }
            parts.back().push_back(sample);
        }
        return parts;
    }

    void put_in_order(Samples& part) {
        for (std::size_t i = 1; i < part.size(); ++i) {
            if (part[i].t_s < part[i - 1].t_s) reordered_.at(part[i].line);
        }
        std::stable_sort(part.begin(), part.end(),
                         [](const RawSample& a, const RawSample& b) { return a.t_s < b.t_s; });
        const auto same = [&](const RawSample& a, const RawSample& b) {
            if (a.t_s != b.t_s) return false;
            repeated_.at(b.line);
            return true;
        };
        part.erase(std::unique(part.begin(), part.end(), same), part.end());
    }

    // How many rows are missing behind sample `i` of a piece that begins at `begin`: a dropped row makes all
    // later stamps late, a late or an early stamp only itself.
    double missing_behind(const Samples& part, std::size_t begin, std::size_t i) const {
        const auto lateness = [&](std::size_t from, std::size_t to) {
            std::vector<double> late;
            for (std::size_t at = from; at < to; ++at)
                late.push_back(part[at].t_s - static_cast<double>(at) * usual_step_s_);
            std::sort(late.begin(), late.end());
            return late;
        };
        const std::vector<double> before =
            lateness(std::max(begin, i + 1 - std::min(i + 1, kWitnesses)), i + 1);
        const std::vector<double> after = lateness(i + 1, std::min(i + 1 + kWitnesses, part.size()));
        // what follows may have gaps of its own, so that most of it is later still
        const double then = after[after.size() < 3 ? 0 : 1];
        return std::round((then - before[before.size() / 2]) / usual_step_s_);
    }

    void cut_at_gaps(const Samples& part) {
        Samples segment;
        std::size_t begin = 0;  // behind the last gap
        for (std::size_t i = 0; i < part.size(); ++i) {
            segment.push_back(part[i]);
            if (i + 1 == part.size()) break;
            const double step_s = part[i + 1].t_s - part[i].t_s;
            if (std::abs(step_s - usual_step_s_) <= kStepTolerance * usual_step_s_) continue;
            const double missing = step_s > usual_step_s_ ? missing_behind(part, begin, i) : 0;
            if (missing >= 1) begin = i + 1;
            if (missing < 1) {
                jitter_.at(part[i + 1].line);
                worst_jitter_s_ = std::max(worst_jitter_s_, std::abs(step_s - usual_step_s_));
            } else if (missing == 1 || missing * usual_step_s_ <= kFilled_s * (1 + kRateTolerance)) {
                filled_.at(part[i + 1].line);
                most_filled_ = std::max(most_filled_, missing);
                for (double n = 1; n <= missing; ++n)
                    segment.push_back(between(part[i], part[i + 1], n / (missing + 1)));
            } else {
                cut_.at(part[i + 1].line);
                longest_gap_s_ = std::max(longest_gap_s_, step_s);
                take(std::move(segment));
                segment.clear();
            }
        }
        take(std::move(segment));
    }

    void take(Samples segment) {
        if (segment.size() < kFewestSamples) {
            if (!segment.empty()) too_short_.at(segment.front().line);
            return;
        }
        duration_s_ += segment.back().t_s - segment.front().t_s;
        steps_ += static_cast<double>(segment.size() - 1);
        segments_.push_back(std::move(segment));
    }

    void finish() {
        const auto times = [](const Happened& h) {
            return std::to_string(h.count) + (h.count == 1 ? " time" : " times");
        };
        note(restarted_, "time starts anew " + times(restarted_) + ", here first: the log is cut there");
        note(reordered_, "rows are out of order " + times(reordered_) + ", here first: put in order");
        note(repeated_,
             "a time stamp is repeated " + times(repeated_) + ", here first: the later row is left out");
        note(filled_, (most_filled_ == 1 ? std::string("one row is")
                                         : "up to " + number_text(most_filled_) + " rows are") +
                          " missing " + times(filled_) +
                          ", before this one first: put between their neighbours");
        note(cut_, "rows are missing " + times(cut_) + ", before this one first, for up to " +
                       seconds(longest_gap_s_) + ": the log is cut there");
        note(too_short_, "pieces of less than " + std::to_string(kFewestSamples) + " samples are left out " +
                             times(too_short_) + ", here first");
        note(jitter_, "time stamps jitter by more than half a step " + times(jitter_) +
                          ", here first, at worst by " + seconds(worst_jitter_s_) +
                          ": the samples are taken for evenly spaced");
        if (segments_.empty()) {
            problem("so many rows are missing that no " + std::to_string(kFewestSamples) +
                    " samples follow each other");
            return;
        }
        const double period_s = duration_s_ / steps_;
        if (raw_.angles && raw_.refreshed_every == 0) raw_.refreshed_every = refreshed_every(raw_);
        for (Samples& segment : segments_) add(std::move(segment), period_s);
    }

    void add(Samples segment, double period_s) {
        MeasuredLog log;
        if (raw_.angles) {
            RawLog part = raw_;
            part.samples = std::move(segment);
            log = speeds_from_angles(part, period_s);
        } else {
            log.period_s = period_s;
            for (const RawSample& s : segment) {
                log.samples.push_back({s.t_s, s.torque_Nm, s.wheel, s.gyro, s.accel_m_per_s2});
                log.lines.push_back(s.line);
            }
        }
        log.has_gyro = raw_.has_gyro;
        log.has_accel = raw_.has_accel;
        log.run = raw_.run;
        logs_.segments.push_back(std::move(log));
    }

    RawLog raw_;
    MeasuredLogs& logs_;
    double usual_step_s_ = 0;
    std::vector<Samples> segments_;
    double duration_s_ = 0, steps_ = 0;  // of all segments
    Happened restarted_, reordered_, repeated_, filled_, cut_, too_short_, jitter_;
    double longest_gap_s_ = 0, worst_jitter_s_ = 0, most_filled_ = 0;
};

}  // namespace

void MeasuredLogs::problem(std::size_t line, std::string message) {
    ++problem_count;
    if (problems.size() < kKeptProblems) problems.push_back({line, std::move(message)});
}

void add_segments(RawLog raw, MeasuredLogs& logs) { Segmenter(std::move(raw), logs).run(); }

}  // namespace wheelwright::tools
