// Identification in words: what each cause means and what to change, for every command that shows one.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/protocol/wheelwright_messages.hpp"

namespace wheelwright::tools {

struct CauseWords {
    std::string_view happened;
    std::string_view change;  // "" where nothing needs to be
};
CauseWords words_of(protocol::IdentCause cause);

// Both in one line: "neither wheel moved ...: raise it, ...".
std::string cause_sentence(protocol::IdentCause cause);

std::string_view words_of(protocol::IdentPhase phase);

// The blocker's name, and where a name does not say what to do, that too.
std::string blocker_text(protocol::Blocker blocker);

// What else a finished identification has to say, one line each, "" where there is nothing: the drives clip,
// the sides are not confirmed, the model lacks something. The torques are 0 where they are not known.
struct TorqueLimit {
    double delivered_Nm = 0, asked_Nm = 0;
};
std::string clipping_sentence(const protocol::IdentStatus& status, const TorqueLimit& limit = {});
std::string sides_sentence(const protocol::IdentStatus& status);
std::string model_sentence(const protocol::IdentStatus& status);

// What the probe has found and the layout that follows from it, as far as it has been told.
class IdentLayout {
  public:
    void take(const protocol::IdentSizing& sizing) { value_.at(std::size_t(sizing.quantity)) = sizing.value; }
    std::optional<double> operator[](protocol::IdentQuantity quantity) const;  // nothing: not known
    // "found: ..." and "chosen: ..."; a line comes when all of it is known.
    std::vector<std::string> sentences() const;

  private:
    std::array<float, protocol::ident_quantity_values.size()> value_{};
};

// It has ended, and K7 and K8 are known.
inline bool identified(const protocol::IdentStatus& status) {
    return status.phase == protocol::IdentPhase::done;
}
inline bool ended(const protocol::IdentStatus& status) { return status.cause != protocol::IdentCause::none; }

}  // namespace wheelwright::tools
