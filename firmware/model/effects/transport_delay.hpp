#pragma once

#include <array>
#include <cstddef>

#include "firmware/model/effect.hpp"

namespace wheelwright::model {

// A command that acts later: tau(t) = u(t - delay), and nothing before the first one.
struct TransportDelay {
    static constexpr std::array<EffectParameterInfo, 1> parameters{{
        {"delay_s", "s", 0.0, 0.05, "from a torque command to its effect"},
    }};
    static constexpr EffectInfo info{"transport_delay",
                                     "commands that take their time on the way to the motor", "dead time",
                                     parameters, "the loop design and the observer count it"};

    // As the controllers count it.
    template <typename Real>
    static constexpr Real controllers_delay_s(const Parameters<Real>& p) {
        return p[0];
    }

    static constexpr int path_place = 10;

    // The torques under way, oldest first: together they last as long as the delay. Where there are more than
    // there is room for, the newest are put together; there is room for the longest delay in steps of 0.3 ms.
    template <typename Real>
    struct Memory {
        static constexpr std::size_t kRoom = 192;
        struct Piece {
            Real torque_Nm{};
            Real lasts_s{};
        };
        std::array<Piece, kRoom> piece{};
        std::size_t first = 0;
        std::size_t count = 0;
        bool begun = false;
    };

    // Exact for any delay and step, with the command held over each step. The delay must not change.
    template <typename Real>
    static constexpr Real deliver(const Parameters<Real>& p, Memory<Real>& memory,
                                  const PathInstant<Real>& at) {
        if (!memory.begun) push(memory, Real(0), p[0]);
        memory.begun = true;
        push(memory, at.torque_Nm, at.step_s);
        Real rest_s = at.step_s;
        Real impulse = 0;
        while (memory.count > 0) {
            auto& oldest = memory.piece[memory.first];
            if (oldest.lasts_s > rest_s || memory.count == 1) {
                impulse += oldest.torque_Nm * rest_s;
                oldest.lasts_s = oldest.lasts_s > rest_s ? oldest.lasts_s - rest_s : Real(0);
                break;
            }
            impulse += oldest.torque_Nm * oldest.lasts_s;
            rest_s -= oldest.lasts_s;
            memory.first = (memory.first + 1) % Memory<Real>::kRoom;
            --memory.count;
        }
        return impulse / at.step_s;
    }

  private:
    template <typename Real>
    static constexpr void push(Memory<Real>& memory, Real torque_Nm, Real lasts_s) {
        constexpr std::size_t kRoom = Memory<Real>::kRoom;
        if (memory.count > 0) {
            auto& newest = memory.piece[(memory.first + memory.count - 1) % kRoom];
            if (newest.torque_Nm == torque_Nm || memory.count == kRoom) {
                const Real both_s = newest.lasts_s + lasts_s;
                if (newest.torque_Nm != torque_Nm && both_s > 0)
                    newest.torque_Nm = (newest.torque_Nm * newest.lasts_s + torque_Nm * lasts_s) / both_s;
                newest.lasts_s = both_s;
                return;
            }
        }
        memory.piece[(memory.first + memory.count++) % kRoom] = {torque_Nm, lasts_s};
    }
};

}  // namespace wheelwright::model
