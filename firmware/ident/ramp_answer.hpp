// What a wheel does to a torque that rises slowly from zero. From where it begins to move, in the time t, a
// rise of s [Nm/s] and an acceleration a per torque give it the speed a s t^2 / 2 and take it a third of that
// speed times t. So the fastest speed seen, and the way to there, tell t and a. Too little rather than too
// much: friction stops the wheel while a mean of its speed still rises. A few operations, no allocation.
#pragma once

namespace wheelwright::ident {

class RampAnswer {
  public:
    // How fast a wheel is, and how far it has gone since the ramp began; forward. On after the ramp's end,
    // while what is seen late still gets faster.
    void note(double speed, double way) {
        if (speed > fastest_) {
            fastest_ = speed;
            way_ = way;
        }
    }
    // a, in the units of note() a second; 0: nothing has moved.
    double per_Nm(double rise_Nm_per_s) const {
        if (!(fastest_ > 0)) return 0;
        const double time_s = 3 * way_ / fastest_;
        return 2 * fastest_ / (rise_Nm_per_s * time_s * time_s);
    }

  private:
    double fastest_ = 0, way_ = 0;
};

}  // namespace wheelwright::ident
