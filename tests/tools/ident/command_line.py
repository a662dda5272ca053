"""`wheelwright ident` as people and scripts meet it: exit statuses, JSON, writing a robot file.

command_line.py WHEELWRIGHT ROBOTS
"""
import json
import math
import os
import pathlib
import random
import re
import subprocess
import sys
import tempfile

program, robots = sys.argv[1], pathlib.Path(sys.argv[2])
failures = 0


def check(condition, what):
    global failures
    print(("ok   " if condition else "FAIL ") + what)
    failures += 0 if condition else 1


def run(*arguments, status):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    check(done.returncode == status, f"status {done.returncode}, expected {status}: {' '.join(map(str, arguments))}")
    if done.returncode != status:
        print(done.stdout + done.stderr)
    return done


def simulate(path, straight=False, began_s=0):
    """A robot with the geometry of default.toml, K7 = 1.2, K8 = 6, 0.04 Nm s/rad of drag, no dry friction."""
    draw = random.Random(5)
    r, b, k7, k8, drag = 0.075, 0.32, 1.2, 6.0, 0.04
    v = w = left = right = 0.0
    lines = ["t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s"]
    for i in range(3000):
        if i % 10 == 0:
            left = draw.uniform(-2, 2)
            right = left if straight else draw.uniform(-2, 2)
        wl, wr = (v - w * b / 2) / r, (v + w * b / 2) / r
        lines.append(f"{began_s + i * 0.01:.3f},{left:.6f},{right:.6f},"
                     f"{wl + draw.gauss(0, 0.02):.7f},{wr + draw.gauss(0, 0.02):.7f}")
        for _ in range(50):
            wl, wr = (v - w * b / 2) / r, (v + w * b / 2) / r
            v += 0.0002 * k7 * (right + left - drag * (wr + wl))
            w += 0.0002 * k8 * (right - left - drag * (wr - wl))
    path.write_text("\n".join(lines) + "\n")


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    log, straight, answer = folder / "drive.csv", folder / "straight.csv", folder / "out.json"
    simulate(log)
    simulate(straight, straight=True)
    stamped = folder / "stamped.csv"
    simulate(stamped, began_s=1_700_000_000)  # 2023-11-14
    os.utime(stamped, (1_600_000_000, 1_600_000_000))
    geometry = ["--wheel-radius", "0.075", "--track", "0.32"]

    run("ident", log, *geometry, "--relative-standard-error", "0.01", "--json", answer, status=0)
    result = json.loads(answer.read_text())
    k = {row["parameter"]: row for row in result["dynamics"]["parameters"]}
    for name, truth in ("K7", 1.2), ("K8", 6.0):
        print(f"     {name} {k[name]['value']:.5g} +- {k[name]['standard_error']:.2g}, truth {truth}")
        check(abs(k[name]["value"] - truth) < 4 * k[name]["standard_error"], f"{name} within its errors")
        check(k[name]["excitation"] > 0.1 and math.isfinite(k[name]["covariance_diagonal"]), f"{name}: evidence")
    check(result["residuals"]["rows"] > 1000, "rows are counted")

    run("ident", log, *geometry, "--relative-standard-error", "1e-6", status=3)
    check(result["verdict"]["good_enough"] is True, "good enough, for programs")
    text = run("ident", straight, *geometry, "--relative-standard-error", "0.05", status=3).stdout
    check(re.search(r"^good enough +no ", text, re.M), "and in words")
    check("not identifiable from these logs" in text, "a straight log says what it cannot tell")
    run("ident", straight, *geometry, "--json", answer, status=3)
    k = {row["parameter"]: row for row in json.loads(answer.read_text())["dynamics"]["parameters"]}
    check(k["K8"]["value"] == "unknown" and isinstance(k["K7"]["value"], float), "no number without evidence")

    said = run("ident", log, status=1).stderr
    check("--wheel-radius" in said, "the missing geometry is asked for")
    said = run("ident", log, *geometry, "--effects", "fricton", status=1).stderr
    check("viscous_friction" in said, "an unknown effect is answered with those there are")
    run("ident", folder / "nothing.csv", *geometry, status=2)
    (folder / "bad.csv").write_text("t_s,tau_left_Nm\n0,1\n")
    said = run("ident", folder / "bad.csv", *geometry, status=2).stderr
    check("bad.csv:1: column tau_right_Nm is missing" in said, "a missing column is said by line")

    # writing: comments stay, what is known is there with its log and day
    robot = folder / "robot.toml"
    robot.write_text((robots / "default.toml").read_text())
    before = robot.read_text()
    run("ident", stamped, "--model", robot, "--write", robot, "--relative-standard-error", "0.01", status=0)
    after = robot.read_text()
    check(all(line in after for line in before.splitlines() if line.startswith("#")), "comments stay")
    check('log = "stamped.csv"' in after and after.count("2023-11-14") == after.count("stamped.csv"),
          "log and day are written")
    said = run("ident", log, "--model", robot, "--write", robot, "--relative-standard-error", "0.01", status=0).stdout
    after = robot.read_text()
    check("without a date" in said and 'log = "drive.csv"' in after and "2023-11-14" not in after,
          "the day of another log does not stay, and that of the file's last change is not that of the log")
    run("check", robot, status=0)
    run("ident", log, *geometry, "--write", folder / "none.toml", status=1)
    said = run("ident", log, "--wheel-radius", "0.08", "--track", "0.32", "--write", robot, status=1).stderr
    check("K5..K8 belong to one geometry" in said, "a file of another geometry is left alone")

    # the bus: what the simulated robot's log says, written into its file
    bus = folder / "bus.log"
    run("sim", "ident", "--seed", "3", "--log", bus, status=0)
    run("ident", bus, *geometry, status=1)  # nodes, signs and gears are missing
    robot.write_text(before)
    run("ident", bus, "--model", robot, "--write", robot, "--json", answer, status=0)
    result = json.loads(answer.read_text())
    check(result["logs"]["list"][0]["form"] == "candump", "the form is recognised")
    check("actuation_delay_s" in robot.read_text(), "the measured delay is written")
    run("check", robot, status=0)

sys.exit(1 if failures else 0)
