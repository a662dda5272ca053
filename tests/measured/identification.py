"""Identification from logs of real machines, against what others published or what other runs of the same
machine say.

identification.py WHEELWRIGHT DATA
"""
import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile

program, data = sys.argv[1], pathlib.Path(sys.argv[2])
failures = 0


def check(condition, what):
    global failures
    print(("ok   " if condition else "FAIL ") + what)
    failures += 0 if condition else 1


def identify(*names, options):
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "out.json"
        done = subprocess.run([program, "ident", *(str(data / name) for name in names), *options, "--json", out],
                              capture_output=True, text=True)
        if done.returncode not in (0, 3):
            print(done.stdout + done.stderr)
            sys.exit(f"identification of {names} ended with {done.returncode}")
        result = json.loads(out.read_text())
    k = {row["parameter"]: row for row in result["dynamics"]["parameters"]}
    effect = {row["effect"] + "." + row["parameter"]: row for row in result["effects"]["parameters"]}
    return done.returncode, k, effect, result


def unknown(row):
    return row["value"] == "unknown" and row["standard_error"] == "unknown"


# EMPS: the parameters of A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Nonlinear
# System Identification Benchmarks, 2019: M 95.1089 kg, Fv 203.5034 N s/m, Fc 20.3935 N (offset -3.1648 N, which no
# effect of the catalogue stands for). Radius 1 m, half the force on each wheel: 1/K7 is the mass, the wheels'
# friction adds up to that of the carriage.
status, k, effect, result = identify("emps_id.csv", options=["--wheel-radius", "1", "--track", "1"])
mass = 1 / k["K7"]["value"]
mass_error = mass * k["K7"]["standard_error"] / k["K7"]["value"]
viscous = 2 * effect["viscous_friction.left_Nm_s_per_rad"]["value"]
viscous_error = 2 * effect["viscous_friction.left_Nm_s_per_rad"]["standard_error"]
dry = 2 * effect["coulomb_friction.left_Nm"]["value"]
dry_error = 2 * effect["coulomb_friction.left_Nm"]["standard_error"]
print(f"EMPS: mass {mass:.2f} +- {mass_error:.2f} kg (95.11), viscous {viscous:.1f} +- {viscous_error:.1f} N s/m "
      f"(203.50), dry {dry:.2f} +- {dry_error:.2f} N (20.39), delay {1e3 * result['actuation']['delay_s']:.2f} "
      f"+- {1e3 * result['actuation']['delay_standard_error_s']:.2f} ms")
for name, ours, error, published, share in (("mass", mass, mass_error, 95.1089, 0.02),
                                            ("viscous friction", viscous, viscous_error, 203.5034, 0.06),
                                            ("dry friction", dry, dry_error, 20.3935, 0.06)):
    check(abs(ours / published - 1) < share, f"{name} within {100 * share:.0f} % of the published")
    check(abs(ours - published) < 2.58 * error, f"{name}: the published lies in the 99 % interval")
    check(error < 0.1 * ours, f"{name}: the interval says something")
for name in "K5", "K6", "K8":
    check(unknown(k[name]), f"{name} is not claimed: the carriage never turns")
check(status == 3, "and the status says that K8 is missing")
check(abs(result["actuation"]["delay_s"]) < 0.001, "no delay beyond a sample")

# The competition robot, driven straight. Radius as in the folder's README; its track is not told and must not
# matter. Commanded voltage stands for torque: back-EMF is in the viscous term.
geometry = ["--wheel-radius", "0.05077", "--track", "0.6"]
runs = {}
for way in "forward", "backward":
    names = [f"frc2881_practice_{speed}_{way}.csv" for speed in ("slow", "fast")]
    _, k, effect, _ = identify(*names, options=geometry)
    runs[way] = (k["K7"], effect["viscous_friction.left_Nm_s_per_rad"], effect["coulomb_friction.left_Nm"])
    print(f"{way}: K7 {k['K7']['value']:.4f} +- {k['K7']['standard_error']:.4f}, viscous "
          f"{runs[way][1]['value']:.4f} +- {runs[way][1]['standard_error']:.4f} Nm s/rad, dry "
          f"{runs[way][2]['value']:.3f} +- {runs[way][2]['standard_error']:.3f} Nm")
    for name in "K5", "K6", "K8":
        check(unknown(k[name]), f"{name} is not claimed: the torques are equal")
for i, name in enumerate(("K7", "viscous friction", "dry friction")):
    one, other = runs["forward"][i], runs["backward"][i]
    apart = abs(one["value"] - other["value"]) / math.hypot(one["standard_error"], other["standard_error"])
    print(f"     {name}: {apart:.2f} standard errors between forward and backward")
    check(apart < 2.5, f"{name} is the same forward and backward")
    check(one["standard_error"] < 0.1 * one["value"], f"{name}: known to 10 % or better")
mass = 1 / (runs["forward"][0]["value"] * 0.05077)
check(20 < mass < 80, f"an effective mass of {mass:.0f} kg: a competition robot with gears and motors")

# One slow ramp alone moves the torque too little.
_, k, _, _ = identify("frc2881_practice_slow_forward.csv", options=geometry)
check(unknown(k["K7"]), "K7 is not claimed from a slow ramp alone")

# Held out: a free run over the fast backward log from its first speed, with what the other three say.
_, k, effect, _ = identify("frc2881_practice_slow_forward.csv", "frc2881_practice_fast_forward.csv",
                           "frc2881_practice_slow_backward.csv", options=geometry)
k7 = k["K7"]["value"]
drag = effect["viscous_friction.left_Nm_s_per_rad"]["value"]
dry = effect["coulomb_friction.left_Nm"]["value"]
with open(data / "frc2881_practice_fast_backward.csv") as file:
    rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
radius = 0.05077
speed = [radius * (row["omega_left_rad_s"] + row["omega_right_rad_s"]) / 2 for row in rows]
v = speed[0]
square = 0.0
for i in range(1, len(rows)):
    for _ in range(20):
        torque = rows[i - 1]["tau_left_Nm"] + rows[i - 1]["tau_right_Nm"]
        v += 0.001 * k7 * (torque - 2 * drag * v / radius - 2 * dry * math.copysign(1, v))
    square += (v - speed[i]) ** 2
rms = math.sqrt(square / (len(rows) - 1))
print(f"held out: K7 {k7:.4f}, free run {rms:.3f} m/s rms beside, at speeds to {max(map(abs, speed)):.2f} m/s")
check(rms < 0.08 * max(map(abs, speed)), "the held-out run is foretold within 8 % of its speed")

sys.exit(1 if failures else 0)
