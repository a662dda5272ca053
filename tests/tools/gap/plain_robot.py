"""A differential drive by its equations of motion, for tests that must not trust this project's simulator:
M u' = (c w^2 + F, d v w + N) + G^T torque, u = (v, w), with the effects of a robot file that are written here
from their formulas. Dry friction by Moreau's time stepping. Nothing of the program is used."""
import math
import random

WRITTEN = {"viscous_friction", "coulomb_friction", "quadratic_drag", "turning_scrub", "torque_bias", "torque_gain_mismatch",
           "cog_lateral", "wheel_radius_mismatch", "transport_delay"}

ROTATION_SHARE = 0.08  # of the mass that K7 tells of: what the wheels' rotation has in it


class Robot:
    """Of a robot file's tables, as tomllib reads them."""

    def __init__(self, file, step_s=0.0005):
        left, right = (file["geometry"]["wheel_radius_m"][side] for side in ("left", "right"))
        self.track_m, mean = file["geometry"]["track_m"], (left + right) / 2
        effects = {name: dict(table) for name, table in file.get("effects", {}).items()}
        assert not set(effects) - WRITTEN, effects
        k = file["dynamics"]
        mass, inertia = 1 / (k["k7_per_kg_m"] * mean), self.track_m / (2 * mean * k["k8_per_kg_m2"])
        self.centrifugal = k.get("k5_m", 0) * mass
        self.coriolis = k["k6_per_m"] * inertia if "k6_per_m" in k else -self.centrifugal
        coupling = -effects.get("cog_lateral", {"offset_m": 0})["offset_m"] * mass
        if "wheel_radius_mismatch" in effects:  # the mean stays, and a wheel's inertia
            wheel = ROTATION_SHARE * mass / (left ** -2 + right ** -2)
            ratio = right / left * (1 + effects["wheel_radius_mismatch"]["relative"])
            were, (left, right) = (left, right), (2 * mean / (1 + ratio), 2 * mean * ratio / (1 + ratio))
            more = [wheel * (now ** -2 - then ** -2) for now, then in zip((left, right), were)]
            mass, inertia = mass + sum(more), inertia + sum(more) * self.track_m ** 2 / 4
            coupling += (more[1] - more[0]) * self.track_m / 2
        self.radius_m = (left, right)
        determinant = mass * inertia - coupling * coupling
        self.inverse = (inertia / determinant, -coupling / determinant, mass / determinant)
        zero = {"left_Nm": 0, "right_Nm": 0}
        viscous = effects.get("viscous_friction", {"left_Nm_s_per_rad": 0, "right_Nm_s_per_rad": 0})
        self.viscous = tuple(viscous[side + "_Nm_s_per_rad"] for side in ("left", "right"))
        self.bias = tuple(effects.get("torque_bias", zero)[side] for side in ("left_Nm", "right_Nm"))
        self.drag = effects.get("quadratic_drag", {"drag_N_s2_per_m2": 0})["drag_N_s2_per_m2"]
        ratio = 1 + effects.get("torque_gain_mismatch", {"relative": 0})["relative"]  # right over left; the sum stays
        self.gain = (2 / (1 + ratio), 2 * ratio / (1 + ratio))
        self.step_s = step_s
        delay = round(effects.get("transport_delay", {"delay_s": 0})["delay_s"] / step_s)
        self.asked = [(0.0, 0.0)] * delay
        # each dry torque: its direction on the body (force, yaw torque), and its limit
        coulomb = effects.get("coulomb_friction", zero)
        self.dry = [[self.push((1, 0)), coulomb["left_Nm"], 0.0], [self.push((0, 1)), coulomb["right_Nm"], 0.0],
                    [(0.0, 1.0), effects.get("turning_scrub", {"scrub_Nm": 0})["scrub_Nm"], 0.0]]
        self.dry = [d for d in self.dry if d[1] > 0]
        self.v = self.w = 0.0

    def push(self, torque):
        """On the body, of torques at the wheels."""
        left, right = torque[0] / self.radius_m[0], torque[1] / self.radius_m[1]
        return left + right, (right - left) * self.track_m / 2

    def wheels(self, v, w):
        half = self.track_m / 2 * w
        return (v - half) / self.radius_m[0], (v + half) / self.radius_m[1]

    def place(self, speeds):
        left, right = speeds[0] * self.radius_m[0], speeds[1] * self.radius_m[1]
        self.v, self.w = (left + right) / 2, (right - left) / self.track_m

    def answer(self, force, yaw):
        i = self.inverse
        return i[0] * force + i[1] * yaw, i[1] * force + i[2] * yaw

    def smooth(self, torque, v, w):
        speeds = self.wheels(v, w)
        at = [self.gain[s] * torque[s] + self.bias[s] - self.viscous[s] * speeds[s] for s in (0, 1)]
        force, yaw = self.push(at)
        return self.answer(force + self.centrifugal * w * w - self.drag * v * abs(v), yaw + self.coriolis * v * w)

    def rub(self, v, w, step_s):
        for _ in range(40):
            moved = 0.0
            for d in self.dry:
                (force, yaw), limit, before = d
                dv, dw = self.answer(force, yaw)
                sliding = force * v + yaw * w
                now = min(limit, max(-limit, before + sliding / (step_s * (force * dv + yaw * dw))))
                d[2] = now
                v, w = v - step_s * (now - before) * dv, w - step_s * (now - before) * dw
                moved = max(moved, abs(now - before) / limit)
            if moved < 1e-12:
                break
        return v, w

    def advance(self, duration_s, torque):
        for _ in range(round(duration_s / self.step_s)):
            h = self.step_s
            self.asked.append(tuple(torque))
            arrives = self.asked.pop(0)
            dv, dw = self.smooth(arrives, self.v, self.w)
            dv, dw = self.smooth(arrives, self.v + h / 2 * dv, self.w + h / 2 * dw)
            v, w = self.v + h * dv, self.w + h * dw
            if self.dry:
                for d in self.dry:  # begins from the last solution
                    rv, rw = self.answer(*d[0])
                    v, w = v - h * d[2] * rv, w - h * d[2] * rw
                v, w = self.rub(v, w, h)
            self.v, self.w = v, w
        return self.wheels(self.v, self.w)


def drive(robot, seed, duration_s, rate_Hz, noise_rad_per_s, spin=False):
    """A log of it: rows (t, torques, noisy wheel speeds), under a loop that follows random speeds, shaken. `spin`:
    the torques only turn it."""
    draw = random.Random(seed)
    rows, change_s, bit_s, v, w, bits = [], 0.0, 0.0, 0.0, 0.0, (0.0, 0.0)
    for i in range(int(duration_s * rate_Hz) + 1):
        t = i / rate_Hz
        if t >= change_s:
            v, w = draw.uniform(-1.2, 1.2), draw.uniform(-2.5, 2.5)
            change_s = t + draw.uniform(0.4, 1.3)
        if t >= bit_s:
            bits, bit_s = (draw.choice((-0.5, 0.5)), draw.choice((-0.5, 0.5))), t + 0.06
        forward, turn = 2.5 * (v - robot.v), 0.6 * (w - robot.w)
        if spin:
            forward, bits = 0, (bits[0], -bits[0])
        torque = tuple(round(max(-3.0, min(3.0, x)), 6) for x in (forward - turn + bits[0], forward + turn + bits[1]))
        speeds = robot.wheels(robot.v, robot.w)
        rows.append((t, torque, tuple(s + draw.gauss(0, noise_rad_per_s) for s in speeds)))
        robot.advance(1 / rate_Hz, torque)
    return rows


def free_run(robot, rows, before=()):
    """Its speeds at the second and later rows, under the rows' torques from the first one's speeds. The rows
    before give what is on its way already."""
    for row, after in zip(before, [*before[1:], rows[0]]):
        robot.place(row[2])
        robot.advance(after[0] - row[0], row[1])
    robot.place(rows[0][2])
    return [robot.advance(after[0] - before[0], before[1]) for before, after in zip(rows, rows[1:])]


def rms(simulated, rows):
    squares = [(s - m) ** 2 for speeds, row in zip(simulated, rows[1:]) for s, m in zip(speeds, row[2])]
    return math.sqrt(sum(squares) / len(squares))
