#!/usr/bin/env python3
"""What `wheelwright gap` finds in logs of real machines.

usage: gap.py WHEELWRIGHT DATA
"""
import csv
import json
import os
import subprocess
import sys
import tempfile
import unittest


class Gap(unittest.TestCase):
    program, data = sys.argv[1:3]

    def analyse(self, logs, *options):
        with tempfile.TemporaryDirectory() as folder:
            paths = [os.path.join(self.data, log) for log in logs]
            run = subprocess.run([self.program, "gap", *paths, *options, "--out", folder], capture_output=True, text=True)
            self.assertEqual(run.returncode, 0, run.stderr)
            with open(os.path.join(folder, "gap.json"), encoding="utf-8") as file:
                found = json.load(file)
            for name in ("report.html", "robot.extended.toml"):
                self.assertTrue(os.path.getsize(os.path.join(folder, name)) > 0)
        for effect in found["effects"]:
            print(effect["name"], [(p["name"], p["value"], p["standard_error"]) for p in effect["parameters"]],
                  [rival["name"] for rival in effect["rivals"]])
        print(found["verdict"], found["heldout"]["wheel_speed_rms_rad_s"])
        return found

    def test_emps_has_both_frictions_and_a_constant_offset(self):
        found = self.analyse(["emps_id.csv"], "--wheel-radius", "1", "--track", "0.5", "--heldout-from", "12.37")
        self.assertEqual(found["verdict"], "named")
        names = {effect["name"]: effect for effect in found["effects"]}
        self.assertEqual(set(names), {"viscous_friction", "coulomb_friction", "torque_bias"})
        self.assertIn("slope", [rival["name"] for rival in names["torque_bias"]["rivals"]])
        # Janot, Gautier, Brunot (2019): 203.5 Ns/m, 20.4 N and -3.2 N for the whole axis, half of it here
        published = {"viscous_friction": 101.7, "coulomb_friction": 10.2, "torque_bias": 1.58}
        for name, value in published.items():
            self.assertLess(abs(names[name]["parameters"][0]["value"] / value - 1), 0.15, name)
        self.assertLessEqual({"K6", "K8"}, set(found["unknowable"]))
        self.assertLess(found["heldout"]["wheel_speed_rms_rad_s"]["after"], 0.006)

    def test_frc_has_drag_and_nothing_is_said_of_turning(self):
        name = "frc2881_practice_{}.csv".format
        found = self.analyse([name("slow_forward"), name("slow_backward"), name("fast_forward")],
                             "--heldout", os.path.join(self.data, name("fast_backward")),
                             "--wheel-radius", "0.05077", "--track", "0.6")
        self.assertEqual((found["verdict"], [effect["name"] for effect in found["effects"]]),
                         ("named", ["viscous_friction", "coulomb_friction"]))
        self.assertIn("back_emf_limit", [rival["name"] for rival in found["effects"][0]["rivals"]])
        self.assertEqual({"K5", "K6", "K8"}, set(found["unknowable"]))
        self.assertEqual({"k7_per_kg_m"}, set(found["parameter_shift"]))
        # Half of the wheels' difference no model of a robot that goes straight explains; nor how their mean scatters
        # about its average once it has settled under a torque that does not change.
        with open(os.path.join(self.data, name("fast_backward")), encoding="utf-8") as file:
            rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        left, right = ([row[f"omega_{side}_rad_s"] for row in rows] for side in ("left", "right"))
        settled = [(a + b) / 2 for row, a, b in zip(rows, left, right) if row["t_s"] > 1.2]
        average = sum(settled) / len(settled)
        halves = sum((a - b) ** 2 / 4 for a, b in zip(left[1:], right[1:])) / (len(rows) - 1)
        floor = halves + sum((x - average) ** 2 for x in settled) / len(rows)
        both, forward = (found["heldout"][of]["after"] for of in ("wheel_speed_rms_rad_s", "forward_rms_rad_s"))
        print(f"free run, rad/s RMS: forward {forward:.2f}; half the difference of the wheels {halves ** 0.5:.2f}; over both "
              f"wheels {both:.2f}, of which no model leaves less than {floor ** 0.5:.2f}")
        self.assertAlmostEqual(both ** 2, forward ** 2 + halves, delta=0.01 * both ** 2)
        self.assertLess(both, 3.0)
        self.assertLess(forward, 2.2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
