"""The sizes that `wheelwright gap` calls detectable, put on the robot it found: named, or a rival of what is named,
at that size in four logs of five, hardly ever at three tenths of it, always at twice. A robot with friction, and one that only spins.
Usage: detection.py PROGRAM"""
import json
import os
import subprocess
import sys
import tempfile
import unittest

import plain_robot

PROGRAM = sys.argv[1]
GEOMETRY = {"wheel_radius_m": {"left": 0.078, "right": 0.078}, "track_m": 0.36}
DYNAMICS = {"k5_m": 0.04, "k7_per_kg_m": 1.1, "k8_per_kg_m2": 5.4}
FRICTION = {"coulomb_friction": {"left_Nm": 0.2, "right_Nm": 0.2},
            "viscous_friction": {"left_Nm_s_per_rad": 0.02, "right_Nm_s_per_rad": 0.02}}


class Detection(unittest.TestCase):
    def verify(self, effects, only, repeats, seed, spin):
        with tempfile.TemporaryDirectory() as folder:
            robot = plain_robot.Robot({"geometry": GEOMETRY, "dynamics": DYNAMICS, "effects": effects}, 0.001)
            log = os.path.join(folder, "drive.csv")
            with open(log, "w", encoding="utf-8") as file:
                file.write("t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s\n")
                for t, torque, speeds in plain_robot.drive(robot, seed, 24, 100, 0.01, spin):
                    file.write(f"{t:.6f},{torque[0]:.8g},{torque[1]:.8g},{speeds[0]:.10g},{speeds[1]:.10g}\n")
            done = subprocess.run([PROGRAM, "gap", log, "--wheel-radius", str(GEOMETRY["wheel_radius_m"]["left"]),
                                   "--track", str(GEOMETRY["track_m"]), "--out", folder, "--verify-detection",
                                   str(repeats), "--verify-sizes", "0.3,1,2", "--verify-only", ",".join(only)],
                                  capture_output=True, text=True, timeout=120)
            self.assertEqual(done.returncode, 0, done.stderr)
            with open(os.path.join(folder, "detection.json"), encoding="utf-8") as file:
                rows = json.load(file)["detection"]["logs"]
        print(done.stdout[done.stdout.find("Effects put on"):])
        self.assertEqual({row["effect"] for row in rows}, set(only))
        named = {size: sum(row["named"] + row["confounded"] for row in rows if row["factor"] == size)
                 for size in (0.3, 1, 2)}
        logs = repeats * len(only)
        self.assertEqual(sum(row["logs"] for row in rows), 3 * logs)
        self.assertLessEqual(named[0.3], 0.1 * logs)
        self.assertGreaterEqual(named[1], 0.8 * logs)
        self.assertEqual(named[2], logs)

    def test_beside_friction(self):
        self.verify(FRICTION, ["quadratic_drag", "torque_bias", "cog_lateral"], 3, 3, spin=False)

    def test_in_a_pure_spin(self):
        self.verify({}, ["viscous_friction", "wheel_radius_mismatch"], 3, 4, spin=True)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
