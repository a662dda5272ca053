#!/usr/bin/env python3
"""`wheelwright gap-bench` on robots that are made up here: their logs, and SysId's figures for them, are this file's own.

usage: made_up_robots.py WHEELWRIGHT
"""
import json
import math
import os
import random
import statistics
import subprocess
import sys
import tempfile
import unittest

STEP_S = 0.02
RUNS = {"slow_forward": (1, "ramp"), "slow_backward": (-1, "ramp"), "fast_forward": (1, "step"), "fast_backward": (-1, "step")}


def drive(robot, direction, kind, noise):
    """Rows of time, torque of each wheel and speeds, of a robot that goes straight: each step of the log in a hundred."""
    gain, viscous, coulomb = robot
    speed, rows = 0.0, []
    for k in range(600 if kind == "ramp" else 150):
        torque = direction * (0.25 * k * STEP_S if kind == "ramp" else 5.0)
        measured = speed + noise.gauss(0, 0.01)
        rows.append((k * STEP_S, torque, torque, measured, speed + noise.gauss(0, 0.01)))
        for _ in range(100):
            push = torque - viscous * speed
            if speed == 0 and abs(push) <= coulomb:
                continue
            after = speed + gain * (push - math.copysign(coulomb, speed or push)) * STEP_S / 100
            speed = 0.0 if speed * after < 0 else after
    return rows


def csv_text(rows):
    head = "t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s\n"
    return head + "".join("%.3f,%.9g,%.9g,%.9g,%.9g\n" % row for row in rows)


def sysid_json(runs, radius):
    """SysId's layout: rotations of the wheel. Angles by the trapezoidal rule of the speeds."""
    tests = {}
    for name, rows in runs.items():
        angle, test = [0.0, 0.0], []
        for before, row in zip([rows[0]] + rows, rows):
            for side in 0, 1:
                angle[side] += (row[0] - before[0]) * (before[3 + side] + row[3 + side]) / 2
            turns = [a / (2 * math.pi) for a in angle]
            test.append([row[0], row[1], row[2], *turns, row[3] / (2 * math.pi), row[4] / (2 * math.pi), 0.0, 0.0])
        tests[name.replace("_", "-")] = test
    return json.dumps({"sysid": True, "test": "Drivetrain", "units": "Meters", "unitsPerRotation": 2 * math.pi * radius, **tests})


def forward(rows):
    return [(row[3] + row[4]) / 2 for row in rows], [(row[1] + row[2]) / 2 for row in rows]


def solve(matrix, right):
    """Gauss, with pivots."""
    n = len(right)
    rows = [list(m) + [r] for m, r in zip(matrix, right)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda j: abs(rows[j][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for j in range(n):
            if j != i:
                share = rows[j][i] / rows[i][i]
                rows[j] = [a - share * b for a, b in zip(rows[j], rows[i])]
    return [rows[i][n] / rows[i][i] for i in range(n)]


def sysid_error(training, held_out, radius):
    """v[k+1] on v[k], sign v, u where the robot drives faster than 0.1 m/s; then a free run."""
    matrix, right = [[0.0] * 3 for _ in range(3)], [0.0] * 3
    for rows in training:
        speed, torque = forward(rows)
        for v, u, after in zip(speed, torque, speed[1:]):
            if min(abs(v), abs(after)) * radius <= 0.1:
                continue
            columns = (v, math.copysign(1, v), u)
            for i in range(3):
                right[i] += columns[i] * after
                for j in range(3):
                    matrix[i][j] += columns[i] * columns[j]
    keeps, sign, gain = solve(matrix, right)
    speed, torque = forward(held_out)
    now, square = speed[0], 0.0
    for u, measured in zip(torque, speed[1:]):
        without = keeps * now + gain * u
        now = math.copysign(max(0.0, abs(without) + sign), without)
        square += (now - measured) ** 2
    return math.sqrt(square / (len(speed) - 1))


class GapBench(unittest.TestCase):
    program = sys.argv[1]
    radius = 0.08

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        noise = random.Random(5)
        robots = {"light": (2.0, 0.25, 0.5), "heavy": (0.5, 0.3, 0.9)}
        cls.logs = {name: {run: drive(robot, *how, noise) for run, how in RUNS.items()} for name, robot in robots.items()}
        entries = {}
        for name, logs in cls.logs.items():
            published = {}
            for run, rows in logs.items():
                others = [log for other, log in logs.items() if other != run]
                speed, _ = forward(rows)
                published[run] = {"signal": round(math.sqrt(statistics.fmean(v * v for v in speed)), 3),
                                  "sysid_regression": round(sysid_error(others, rows, cls.radius), 3), "torque_only": None}
            entries[name] = {"wheel_radius_m": cls.radius, "track_m": 0.5, "heldout_rms_rad_s": published}
            cls.write(f"{name}/unused.txt", "not a log")
            for run, rows in logs.items():
                cls.write(f"{name}/{run}.csv", csv_text(rows))
            # a spin says nothing of going forward, and is no run here
            cls.write(f"{name}/spin.csv", csv_text([(t, -u, u, -v, v) for t, u, _, v, _ in logs["fast_forward"]]))
        cls.write("robots.json", json.dumps(entries))

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def write(cls, name, text):
        path = os.path.join(cls.folder.name, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
        return path

    def bench(self, *options, status=(0, 3)):
        out = os.path.join(self.folder.name, "figures.json")
        run = subprocess.run([self.program, "gap-bench", *options, "--json", out], capture_output=True, text=True)
        self.assertIn(run.returncode, status, run.stdout + run.stderr)
        if run.returncode not in (0, 3):
            return run.stderr
        print(run.stdout)
        with open(out, encoding="utf-8") as file:
            figures = json.load(file)
        figures["status"] = run.returncode
        return figures

    def test_every_run_is_held_out_once(self):
        figures = self.bench(self.folder.name, "--jobs", "2")
        splits = figures["splits"]["list"]
        self.assertEqual([(s["robot"], s["held_out"]) for s in splits],
                         [(robot, run) for robot in sorted(self.logs) for run in sorted(RUNS)])
        for split in splits:
            logs = self.logs[split["robot"]]
            others = [rows for run, rows in logs.items() if run != split["held_out"]]
            expected = sysid_error(others, logs[split["held_out"]], self.radius)
            self.assertAlmostEqual(split["sysid_rad_s"] / expected, 1, delta=2e-3)
            # friction and noise alone: whoever fits both comes close
            self.assertLess(split["plain_rad_s"], 0.3)
            self.assertGreater(split["torque_alone_rad_s"], split["sysid_rad_s"])
            self.assertTrue(split["verdict"])
        for check in figures["checks"]["published"]:
            self.assertEqual(check["equal"], check["compared"])
        self.assertEqual([check["compared"] for check in figures["checks"]["published"]], [8, 0, 8])
        # the aims are what the splits say
        ratios = [math.inf if s["gap_rad_s"] is None else s["gap_rad_s"] / s["sysid_rad_s"] for s in splits]
        aims = figures["aims"]["list"]
        measured = statistics.median(ratios)
        self.assertAlmostEqual(aims[0]["measured"], measured, delta=1e-3 * measured)
        self.assertAlmostEqual(aims[1]["measured"], sum(r <= 1.1 for r in ratios) / len(ratios), delta=1e-9)
        self.assertEqual(figures["status"], 0 if all(aim["reached"] for aim in aims) else 3)

    def test_one_robot_from_a_sysid_file(self):
        folder = os.path.join(self.folder.name, "sysid")
        self.write("sysid/robots.json", json.dumps({"light": {"wheel_radius_m": self.radius, "track_m": 0.5, "Nm_per_V": 1}}))
        self.write("sysid/light/log.json", sysid_json(self.logs["light"], self.radius))
        splits = self.bench(folder, "--robot", "light")["splits"]["list"]
        self.assertEqual([s["held_out"] for s in splits], sorted(RUNS))
        for split in splits:
            speed, _ = forward(self.logs["light"][split["held_out"]])
            self.assertAlmostEqual(split["signal_rad_s"] / math.sqrt(statistics.fmean(v * v for v in speed)), 1, delta=0.01)
            self.assertNotEqual(split["verdict"], "")

    def test_a_log_that_cannot_be_used_is_a_refusal_of_its_own_split(self):
        folder = os.path.join(self.folder.name, "broken")
        self.write("broken/robots.json", json.dumps({"light": {"wheel_radius_m": self.radius, "track_m": 0.5}}))
        for run in "slow_forward", "slow_backward", "fast_forward":
            self.write(f"broken/light/{run}.csv", csv_text(self.logs["light"][run]))
        self.write("broken/light/bad.csv", "t_s,tau_left_Nm\n0,oops\n")
        figures = self.bench(folder)
        self.assertEqual(len(figures["splits"]["list"]), 3)
        self.assertEqual(figures["refusals"]["list"][0]["held_out"], "bad")
        self.assertIn("bad.csv:1: column tau_right_Nm is missing", figures["refusals"]["list"][0]["reason"])

    def test_one_log_is_split_where_it_is_asked(self):
        rows = []
        for run in "slow_forward", "fast_backward", "slow_backward", "fast_forward":
            first = rows[-1][0] + STEP_S if rows else 0.0
            rows += [(first + row[0], *row[1:]) for row in self.logs["heavy"][run]]
        path = self.write("one.csv", csv_text(rows))
        figures = self.bench(path, "--wheel-radius", "0.08", "--track", "0.5", "--split", "40,60")
        splits = figures["splits"]["list"]
        self.assertEqual([s["held_out"] for s in splits], ["40 %", "60 %"])
        for split, share in zip(splits, (0.4, 0.6)):
            speed, _ = forward(rows[int(share * len(rows)):])
            self.assertAlmostEqual(split["signal_rad_s"] / math.sqrt(statistics.fmean(v * v for v in speed)), 1, delta=1e-3)
        self.assertEqual(figures["aims"]["list"][0]["reached"], figures["status"] == 0)

    def test_what_is_wrong_is_said(self):
        self.assertIn("robots.json: has no robot nobody", self.bench(self.folder.name, "--robot", "nobody", status=(2,)))
        self.assertIn("robots.json: cannot be opened", self.bench(os.path.join(self.folder.name, "light"), status=(2,)))
        self.write("wrong/robots.json", json.dumps({"light": {"wheel_radius_m": -1, "track_m": 0.5}}))
        self.assertIn("light: wheel_radius_m is -1, expected a number greater than 0",
                      self.bench(os.path.join(self.folder.name, "wrong"), status=(2,)))
        self.write("wrong/robots.json", "{")
        self.assertIn("robots.json: is not JSON", self.bench(os.path.join(self.folder.name, "wrong"), status=(2,)))
        log = self.write("short.csv", csv_text(self.logs["light"]["fast_forward"]))
        self.assertIn("one log needs --wheel-radius and --track", self.bench(log, status=(1,)))
        self.assertIn("gap --help does not end well", self.bench(self.folder.name, "--analyser", "/bin/false", status=(1,)))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
