"""Figures of `wheelwright gap` as a stranger checks them: from the written robot files and the log alone, by
`wheelwright free-run`, by hand from its speeds, and by equations of motion of this test's own (plain_robot.py).
Usage: claims.py PROGRAM"""
import csv
import json
import os
import subprocess
import sys
import tempfile
import tomllib
import unittest

import plain_robot

PROGRAM = sys.argv[1]
GEOMETRY = {"wheel_radius_m": {"left": 0.081, "right": 0.081}, "track_m": 0.42}
DYNAMICS = {"k5_m": 0.05, "k7_per_kg_m": 0.95, "k8_per_kg_m2": 4.3}
NOISE_RAD_PER_S = 0.01
RATE_HZ = 100


def run(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=120)
    if done.returncode != 0:
        raise AssertionError(f"{arguments}: {done.stderr}")
    return done.stdout


class Claims(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def path(self, name):
        return os.path.join(self.folder, name)

    def write_log(self, name, rows):
        with open(self.path(name), "w", encoding="utf-8") as file:
            file.write("t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s\n")
            for t, torque, speeds in rows:
                file.write(f"{t:.6f},{torque[0]:.8g},{torque[1]:.8g},{speeds[0]:.10g},{speeds[1]:.10g}\n")
        return self.path(name)

    def log_of(self, effects, seed=5, duration_s=40):
        robot = plain_robot.Robot({"geometry": GEOMETRY, "dynamics": DYNAMICS, "effects": effects}, 0.001)
        rows = plain_robot.drive(robot, seed, duration_s, RATE_HZ, NOISE_RAD_PER_S)
        return rows, self.write_log("drive.csv", rows)

    def gap(self, log, *more):
        run("gap", log, "--wheel-radius", GEOMETRY["wheel_radius_m"]["left"], "--track", GEOMETRY["track_m"], "--out",
            self.path("gap"), *more)
        with open(self.path("gap/gap.json"), encoding="utf-8") as file:
            found = json.load(file)
        with open(self.path("gap/report.html"), encoding="utf-8") as file:
            return found, file.read()

    def repeat(self, log, robot, *more):
        run("free-run", log, "--robot", self.path("gap/" + robot), "--json", self.path("run.json"), "--csv",
            self.path("run.csv"), *more)
        with open(self.path("run.json"), encoding="utf-8") as file:
            said = json.load(file)["run"]
        with open(self.path("run.csv"), encoding="utf-8") as file:
            return said, [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]

    def by_hand(self, speeds):
        squares = [(s[f"simulated_{side}_rad_s"] - s[f"measured_{side}_rad_s"]) ** 2
                   for s in speeds for side in ("left", "right")]
        return (sum(squares) / len(squares)) ** 0.5

    def check(self, effects, named, apart=0.02):
        rows, log = self.log_of(effects)
        found, page = self.gap(log)
        self.assertEqual(sorted(e["name"] for e in found["effects"]), sorted(named), found["reason"])
        held_out = found["heldout"]
        before = [row for row in rows if -1 < row[0] - held_out["from_s"] < -1e-9]
        kept = [row for row in rows if row[0] >= held_out["from_s"] - 1e-9]
        for which, robot in (("before", "robot.before.toml"), ("after", "robot.extended.toml")):
            claimed = held_out["wheel_speed_rms_rad_s"][which]
            said, speeds = self.repeat(log, robot, "--from", held_out["from_s"])
            with open(self.path("gap/" + robot), "rb") as file:
                mine = plain_robot.Robot(tomllib.load(file), 0.001)
            own = plain_robot.rms(plain_robot.free_run(mine, kept, before), kept)
            if claimed is None:  # it runs away: farther off than a robot that stands
                self.assertIsNone(said["windows"][-1]["wheel_speed_rms_rad_s"])
                self.assertGreater(own, held_out["signal_rms_rad_s"])
                continue
            # the program's simulator says it again, with each window
            for window in held_out["windows"]:
                again = next(w for w in said["windows"] if w["window_s"] == window["window_s"])
                self.assertEqual(again["windows"], window["windows"])
                self.assertAlmostEqual(again["wheel_speed_rms_rad_s"], window[which], delta=1e-9)
            self.assertAlmostEqual(said["windows"][-1]["wheel_speed_rms_rad_s"], claimed, delta=1e-9)
            # its speeds are compared with the log's own
            self.assertEqual(len(speeds), len(kept) - 1)
            for line, row in zip(speeds, kept[1:]):
                self.assertAlmostEqual(line["measured_left_rad_s"], row[2][0], delta=1e-8)
            self.assertAlmostEqual(self.by_hand(speeds), claimed, delta=1e-6 * claimed)
            # the page says it
            self.assertIn(f">{float(f'{claimed:.3g}'):g}<", page)
            # the equations of motion say it
            self.assertAlmostEqual(own, claimed, delta=apart * claimed, msg=which)
        self.assertLess(claimed, 3 * NOISE_RAD_PER_S)

    def test_what_cannot_be_run_is_said(self):
        robot = self.path("robot.toml")
        log = self.write_log("short.csv", [(i / 100, (0.1, 0.1), (i / 50, i / 50)) for i in range(100)])
        for text, arguments, status, said in (
                (None, [], 1, "robot.toml: cannot open"),
                ("[geometry]\ntrack_m = 0.4\n", [], 1, "neither K7 nor K8 is known"),
                ("[dynamics]\nk7_per_kg_m = 1.0\n", ["--from", 9], 2, "nothing is left to run over")):
            if text:
                with open(robot, "w", encoding="utf-8") as file:
                    file.write(text)
            done = subprocess.run([PROGRAM, "free-run", log, "--robot", robot, *map(str, arguments)], capture_output=True,
                                  text=True, timeout=60)
            self.assertEqual(done.returncode, status, done.stderr)
            self.assertIn(said, done.stderr)

    def test_friction(self):
        self.check({"coulomb_friction": {"left_Nm": 0.2, "right_Nm": 0.2},
                    "viscous_friction": {"left_Nm_s_per_rad": 0.02, "right_Nm_s_per_rad": 0.02}},
                   ["coulomb_friction", "viscous_friction"])

    def test_drives_that_differ_beside_drag(self):
        self.check({"torque_gain_mismatch": {"relative": 0.1}, "quadratic_drag": {"drag_N_s2_per_m2": 3}},
                   ["torque_gain_mismatch", "quadratic_drag"])

    def test_a_late_torque(self):
        self.check({"transport_delay": {"delay_s": 0.025}}, ["transport_delay"])

    def test_scrub_and_bias(self):
        self.check({"turning_scrub": {"scrub_Nm": 0.3}, "torque_bias": {"left_Nm": 0.1, "right_Nm": -0.05}},
                   ["turning_scrub", "torque_bias"])

    def test_centre_of_gravity_beside_the_middle(self):
        self.check({"cog_lateral": {"offset_m": 0.03}}, ["cog_lateral"])

    def test_unequal_radii(self):
        self.check({"wheel_radius_mismatch": {"relative": 0.03}}, ["wheel_radius_mismatch"])

    def test_unequal_radii_beside_friction(self):
        friction = {"coulomb_friction": {"left_Nm": 0.2, "right_Nm": 0.2},
                    "viscous_friction": {"left_Nm_s_per_rad": 0.02, "right_Nm_s_per_rad": 0.02}}
        # this test's steps of 1 ms are coarse for wheels that stop
        self.check({"wheel_radius_mismatch": {"relative": 0.05}, **friction}, ["wheel_radius_mismatch", *friction], 0.05)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
