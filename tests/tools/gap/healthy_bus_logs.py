#!/usr/bin/env python3
"""Healthy robots on their bus: `wheelwright gap` finds nothing missing in their logs, whatever the drives' encoder loops.

usage: healthy_bus_logs.py WHEELWRIGHT [COUNT [SEED [FOLDER]]]     FOLDER: keeps logs and answers

Robots that nobody tuned for are drawn (`wheelwright robots`). What a tape measure got wrong is put right and the frictions are
in the model, so that nothing is missing. The drives' encoder loops have 200 to 8000 rad/s, in turn, and both generations.
`wheelwright ident` has read K5 to K8 from the same logs before: none is off by more than six of its standard errors.
"""
import collections
import json
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

LOOPS_rad_per_s = (1000, 200, 8000, 500, 2000, 4000)
ACTIONS = ("ident", "figure-eight")
SLOWEST_UNSEEN_rad_per_s = 4000  # from here on a drive (8 kHz) reports what it has just read
LOOP_WITHIN = 0.1
MOST_ERRORS = 6


def with_value(text, table, key, value):
    """The text with this line in its table, in place of the one that was there."""
    line = f"{key} = {value}\n"
    begin = re.search(rf"^\[{re.escape(table)}\].*\n", text, re.M)
    if not begin:
        return f"{text}\n[{table}]\n{line}"
    end = re.compile(r"^\[", re.M).search(text, begin.end())
    end = end.start() if end else len(text)
    body = re.sub(rf"^{key} =.*\n", "", text[begin.end():end], flags=re.M)
    return text[:begin.end()] + line + body + text[end:]


def value_of(text, table, key):
    return re.search(rf"^\[{re.escape(table)}\][^\[]*^{key} = ([^#\n]*)", text, re.M)[1].strip()


def whole_table(text, table):
    return re.search(rf"^\[{re.escape(table)}\].*\n(?:(?!\[).*\n)*", text, re.M)[0]


class Robot:
    def __init__(self, program, folder, number):
        self.program, self.folder, self.number = program, folder, number
        self.errors = []
        self.loop_rad_per_s = LOOPS_rad_per_s[(number - 1) % len(LOOPS_rad_per_s)]
        self.generation = 5 + (number + (number - 1) // len(LOOPS_rad_per_s)) % 2  # each loop with both, in turn
        with open(os.path.join(folder, "robot.toml"), encoding="utf-8") as file:
            robot = file.read()
        with open(os.path.join(folder, "plant.toml"), encoding="utf-8") as file:
            plant = file.read()
        for side in ("left", "right"):
            plant = with_value(plant, f"drive.{side}", "torque_scale", 1.0)
            constant = value_of(robot, f"drive.{side}", "torque_constant_Nm_per_A")
            plant = with_value(plant, f"drive.{side}", "torque_constant_Nm_per_A", constant)
        # neither drive clips
        limit_A = 3 * float(value_of(plant, "simulation", "current_limit_A"))
        plant = with_value(plant, "simulation", "current_limit_A", limit_A)
        for key in ("wheel_radius_m", "track_m"):
            robot = with_value(robot, "geometry", key, value_of(plant, "geometry", key))
        robot = re.sub(r"^\[effects\.[^\[]*", "", robot, flags=re.M)
        for effect in re.findall(r"^\[(effects\..*)\]", plant, re.M):
            robot += "\n" + whole_table(plant, effect)
        plant = with_value(plant, "simulation", "velocity_filter_rad_per_s", float(self.loop_rad_per_s))
        # this is of encoder loops; reports that come seldom are not read from bus logs well enough yet
        robot = with_value(robot, "drive", "encoder_period_ms", 1)
        plant = with_value(plant, "drive", "encoder_period_ms", 1)
        robot = with_value(robot, "drive", "generation", self.generation)
        plant = with_value(plant, "drive", "generation", self.generation)
        self.robot, self.plant = os.path.join(folder, "healthy.toml"), os.path.join(folder, "truth.toml")
        for path, text in ((self.robot, robot), (self.plant, plant)):
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)

    def errors_of_ident(self, figures, found):
        """(truth less value) over standard error of K5 to K8, by what `sim` and `ident` have written."""
        with open(figures, encoding="utf-8") as file:
            driven = next(section for key, section in json.load(file).items() if key.startswith("ident_"))
        with open(found, encoding="utf-8") as file:
            rows = {row["parameter"]: row for row in json.load(file)["dynamics"]["parameters"]}
        return [(row["true_value"] - rows[row["name"]]["value"]) / rows[row["name"]]["standard_error"]
                for row in driven["parameters"][:4] if isinstance(rows[row["name"]]["value"], float)]

    def run(self, *arguments):
        done = subprocess.run([self.program, *arguments], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout + done.stderr

    def judge(self):
        """(verdict, names and what they are), of the log of an identification and a figure-8."""
        log, out = os.path.join(self.folder, "bus.log"), os.path.join(self.folder, "gap")
        driven, found = os.path.join(self.folder, "driven.json"), os.path.join(self.folder, "found.json")
        status, text = self.run("sim", "--robot", self.robot, "--plant", self.plant, "--seed", str(self.number), "--log", log,
                                "--json", driven, *ACTIONS)
        if status not in (0, 3):
            return "not driven", text.splitlines()[-1:]
        self.run("ident", log, "--model", self.robot, "--write", self.robot, "--json", found)
        self.errors = self.errors_of_ident(driven, found)
        if max(map(abs, self.errors), default=0) > MOST_ERRORS:
            return "K5 to K8 misread", [f"{error:.1f}" for error in self.errors]
        status, text = self.run("gap", log, "--model", self.robot, "--out", out)
        if not os.path.exists(os.path.join(out, "gap.json")):
            return "no answer", text.splitlines()[-1:]
        with open(os.path.join(out, "gap.json"), encoding="utf-8") as file:
            answer = json.load(file)
        if answer["verdict"] == "unusable_log":
            return "unusable_log", text.splitlines()[-1:]
        seen = re.search(r"encoder loops have (\S+) \(left\) and (\S+) ", text)
        if not seen and self.loop_rad_per_s < SLOWEST_UNSEEN_rad_per_s:
            return "loop not seen", []
        for value in seen.groups() if seen else ():
            if self.loop_rad_per_s < SLOWEST_UNSEEN_rad_per_s and abs(float(value) / self.loop_rad_per_s - 1) > LOOP_WITHIN:
                return "loop misread", [value]
        words = [f"{e['name']} {p['value']:.3g} +- {p['standard_error']:.2g}"
                 for e in answer["effects"] for p in e["parameters"]]
        return answer["verdict"], words


def main():
    program = sys.argv[1]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 6
    seed = sys.argv[3] if len(sys.argv) > 3 else "1"
    with tempfile.TemporaryDirectory() as temporary:
        folder = sys.argv[4] if len(sys.argv) > 4 else temporary
        subprocess.run([program, "robots", "--seed", seed, "--count", str(count), "--draw-only", "--write", folder], check=True)
        robots = [Robot(program, os.path.join(folder, str(n)), n) for n in range(1, count + 1)]
        with ThreadPoolExecutor(2) as pool:
            verdicts = list(pool.map(Robot.judge, robots))
    table = collections.defaultdict(collections.Counter)
    for robot, (verdict, words) in zip(robots, verdicts):
        table[robot.loop_rad_per_s][verdict] += 1
        print(f"{robot.number:3} {robot.loop_rad_per_s:5} rad/s, generation {robot.generation}: {verdict} {', '.join(words)}")
    for loop, counts in sorted(table.items()):
        print(f"{loop:5} rad/s: " + ", ".join(f"{verdict} {n}" for verdict, n in counts.most_common()))
    wrong = sum(verdict != "nothing_missing" for verdict, _ in verdicts)
    errors = [abs(error) for robot in robots for error in robot.errors]
    print(f"K5 to K8 by ident, {len(errors)}: {100 * sum(error < 1.96 for error in errors) / max(1, len(errors)):.1f} % of the "
          f"95 % intervals hold the truth; the largest error is {max(errors, default=0):.1f} standard errors")
    print(f"{count - wrong} of {count}: nothing_missing")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
