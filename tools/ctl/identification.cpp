#include "tools/ctl/identification.hpp"

#include <unistd.h>

#include <cmath>
#include <cstdio>

#include "firmware/model/robot_parameters.hpp"
#include "tools/cli/ident_words.hpp"

namespace wheelwright::tools {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kSilent_ns = kSecond_ns;  // Status comes each 20 ms
constexpr std::int64_t kLook_ns = kSecond_ns / 10;
constexpr std::int64_t kTelling_ns = 10 * kSecond_ns;  // between two lines where there is no terminal
constexpr std::int64_t kRolling_ns = 5 * kSecond_ns;   // a robot that coasts after a fault
// Slower than this it stands; the wheels' speeds have noise.
constexpr double kStanding_m_per_s = 0.02, kStanding_rad_per_s = 0.1;

// What the firmware says of it, each latest.
struct Heard {
    std::optional<protocol::Status> status;
    std::optional<protocol::IdentStatus> ident;
    std::optional<protocol::EstimateK5K7> k5_k7;
    std::optional<protocol::EstimateK6K8> k6_k8;
    std::optional<protocol::StandardErrorK5K7> error_k5_k7;
    std::optional<protocol::StandardErrorK6K8> error_k6_k8;
    IdentLayout layout;

    void take(const hal::CanFrame& frame) {
        note(status, frame);
        note(ident, frame);
        note(k5_k7, frame);
        note(k6_k8, frame);
        note(error_k5_k7, frame);
        note(error_k6_k8, frame);
        if (const auto sizing = Link::decoded<protocol::IdentSizing>(frame)) layout.take(*sizing);
    }
    // All that the end is told by.
    bool whole() const { return ident && k5_k7 && k6_k8 && error_k5_k7 && error_k6_k8; }

  private:
    template <typename Message>
    static void note(std::optional<Message>& into, const hal::CanFrame& frame) {
        if (const auto message = Link::decoded<Message>(frame)) into = message;
    }
};

// A line that is written again and again on a terminal; one now and then elsewhere.
class Progress {
  public:
    void show(const Heard& heard) {
        if (!heard.status || !heard.ident || ended(*heard.ident)) return;
        const std::int64_t now_ns = can_now_ns();
        if (now_ns < due_ns_) return;
        due_ns_ = now_ns + (terminal_ ? kLook_ns : kTelling_ns);
        if (!terminal_ && now_ns < begin_ns_ + kTelling_ns) return;
        std::printf("%s%3.0f s  %3.0f %%  %s%s", terminal_ ? "\r" : "", elapsed_s(),
                    heard.status->progress_percent, std::string(words_of(heard.ident->phase)).c_str(),
                    terminal_ ? "\033[K" : "\n");
        std::fflush(stdout);
        open_ = terminal_;
    }
    void end() {
        if (open_) std::printf("\r\033[K");
        std::fflush(stdout);
        open_ = false;
    }
    double elapsed_s() const { return 1e-9 * static_cast<double>(can_now_ns() - begin_ns_); }

  private:
    const bool terminal_ = ::isatty(STDOUT_FILENO) == 1;
    const std::int64_t begin_ns_ = can_now_ns();
    std::int64_t due_ns_ = begin_ns_ + (terminal_ ? 0 : kTelling_ns);
    bool open_ = false;
};

// limits.torque_Nm as the firmware has it now; 0: no answer.
double torque_limit_Nm(Link& link) {
    using protocol::ParameterOperation;
    const std::uint16_t index = model::find_parameter("limits.torque_Nm")->index;
    if (link.send(parameter_request(ParameterOperation::read, index, 0)) != kDone) return 0;
    const std::int64_t deadline_ns = can_now_ns() + kSecond_ns / 4;
    while (const auto reply = link.wait_for<protocol::ParameterReply>(deadline_ns)) {
        if (reply->operation == ParameterOperation::read && reply->index == index)
            return static_cast<double>(reply->value);
    }
    return 0;
}

bool stands(const protocol::BodyState& body) {
    return std::abs(body.forward_speed_m_per_s) < kStanding_m_per_s &&
           std::abs(body.yaw_rate_rad_per_s) < kStanding_rad_per_s;
}

void tell_found(const Heard& heard) {
    const auto row = [](const char* name, float value, float error, const char* unit) {
        std::printf("  %s  %s %s\n", name,
                    with_error(static_cast<double>(value), static_cast<double>(error)).c_str(), unit);
    };
    const bool coupling = heard.ident->cause != protocol::IdentCause::coupling_not_known;
    row("K7", heard.k5_k7->k7_per_kg_m, heard.error_k5_k7->k7_per_kg_m, "1/(kg m)");
    row("K8", heard.k6_k8->k8_per_kg_m2, heard.error_k6_k8->k8_per_kg_m2, "1/(kg m^2)");
    row("K5", heard.k5_k7->k5_m, heard.error_k5_k7->k5_m, coupling ? "m" : "m, not kept");
    row("K6", heard.k6_k8->k6_per_m, heard.error_k6_k8->k6_per_m, coupling ? "1/m" : "1/m, not kept");
    std::printf("  delay  %.2f ms\n", 1e3 * heard.ident->delay_s);
}

}  // namespace

int await_identification(Link& link) {
    const auto complain = [&](const std::string& text) { return link.options().complain(kAimMissed, text); };
    Progress progress;
    Heard heard;
    bool begun = false;
    bool asked_idle = false;
    double asked_Nm = 0;
    const auto ask_idle = [&] {
        progress.end();
        forget_interrupt();
        asked_idle = true;
        std::printf("Ctrl-C: the robot is asked for idle\n");
        std::fflush(stdout);
        return link.ask(protocol::Mode::idle);
    };

    std::int64_t heard_ns = can_now_ns();
    for (;;) {
        if (interrupted()) {
            if (asked_idle) return complain("not waited for: the robot may still move");
            if (const int status = ask_idle(); status != kDone) return status;
            heard_ns = can_now_ns();
        }
        hal::CanFrame frame;
        if (link.receive(frame, can_now_ns() + kLook_ns)) {
            heard.take(frame);
            if (frame.id == protocol::Status::id) {
                heard_ns = can_now_ns();
                if (heard.status->state != protocol::Mode::ident) break;
                if (!begun) asked_Nm = torque_limit_Nm(link);
                begun = true;
            }
        } else if (!interrupted() && can_now_ns() > heard_ns + kSilent_ns) {
            progress.end();
            return complain("the firmware has gone: its Status frames have ceased");
        }
        progress.show(heard);
    }
    progress.end();
    const double lasted_s = progress.elapsed_s();
    if (!begun) return complain("not begun: " + link.text_of(*heard.status));

    // What is said from now on is the end's, and the robot may still roll after a fault.
    heard.ident.reset();
    heard.k5_k7.reset();
    heard.k6_k8.reset();
    heard.error_k5_k7.reset();
    heard.error_k6_k8.reset();
    const std::int64_t last_ns = can_now_ns() + kRolling_ns;
    while (can_now_ns() < last_ns && !(heard.whole() && stands(link.body()))) {
        hal::CanFrame frame;
        if (link.receive(frame, last_ns)) heard.take(frame);
        if (interrupted()) break;
    }
    if (!heard.whole()) return complain("the identification has ended, but the firmware does not say how");
    if (!stands(link.body())) complain("the robot still moves");
    if (heard.status->state != protocol::Mode::idle)
        complain("the robot has left ident: " + link.text_of(*heard.status));

    const protocol::IdentStatus& ident = *heard.ident;
    for (const std::string& line : heard.layout.sentences()) std::printf("%s\n", line.c_str());
    if (!identified(ident)) {
        complain("not identified after " + number_text(lasted_s, 2) + " s, " + cause_sentence(ident.cause));
        const std::string clipping = clipping_sentence(ident);
        if (!clipping.empty()) complain(clipping);
        return complain("nothing is kept: the model is what it was");
    }
    std::printf("identified after %.0f s: %s\n", lasted_s, cause_sentence(ident.cause).c_str());
    tell_found(heard);
    const double delivered_Nm = ident.torque_clipped ? torque_limit_Nm(link) : 0.0;
    for (const std::string& line :
         {clipping_sentence(ident, {delivered_Nm, asked_Nm}), sides_sentence(ident), model_sentence(ident)})
        if (!line.empty()) std::printf("%s\n", line.c_str());
    std::printf(
        "this is the controllers' model now; `wheelwright ctl param save` writes it into the robot file\n");
    return heard.status->state == protocol::Mode::idle ? kDone : kAimMissed;
}

}  // namespace wheelwright::tools
