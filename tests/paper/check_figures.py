#!/usr/bin/env python3
"""Judges the figures of `wheelwright paper --json` against numbers that come from elsewhere: the paper's table,
formulas, and the trials named in the design notes. check_figures.py FIGURES.json"""
import json
import math
import sys

# Table 1 as printed
PAPER = {"K5": 0.00431, "K6": 0.18510, "K7": 18.7807, "K8": -14.3839}
PAPER_COVARIANCE = {"K7": 1.9617e-6, "K8": 1.9497e-6}
ROWS = ["arx", "recursive", "cascade", "regressions", "torque", "prbs", "table1", "table1_covariance", "intervals",
        "linearisation", "velocity", "overshoot", "overshoot_sampled", "overshoot_chain", "pose", "figure_eight",
        "adaptation", "any_robot"]
THROUGH_CAN = {"regressions", "torque", "prbs", "velocity", "overshoot_chain", "pose", "figure_eight", "adaptation"}

failed = 0


def claim(what, true, measured):
    global failed
    print(f"{'ok  ' if true else 'FAIL'} {what}: {measured}")
    failed += not true


def near(value, wanted, tolerance):
    return value is not None and abs(value - wanted) <= tolerance


with open(sys.argv[1], encoding="utf-8") as file:
    figures = json.load(file)

rows = {row["id"]: row for row in figures["paper"]["rows"]}
claim("every row of the paper is there", list(rows) == ROWS, len(rows))
for name, row in rows.items():
    claim(f"row {name}", row["met"], row["measured"])
claim("what should run through CAN does", {n for n, r in rows.items() if r["through"] == "CAN"} == THROUGH_CAN,
      sorted(n for n, r in rows.items() if r["through"] == "CAN"))
claim("verdict and rows agree", figures["result"]["all_met"] == all(r["met"] for r in rows.values()),
      figures["result"])

for entry in figures["table1"]["parameters"]:
    name = entry["name"]
    share = 1e-3 if name in ("K7", "K8") else 1e-2
    claim(f"{name} of Table 1", near(entry["ours"] / PAPER[name], 1, share), entry["ours"])
    if name in PAPER_COVARIANCE:
        claim(f"P of {name}", near(entry["covariance"] / PAPER_COVARIANCE[name], 1, 0.05), entry["covariance"])
plain = {entry["name"]: entry["plain_relative_error"] for entry in figures["table1"]["parameters"]}
claim("the print's plain difference leaves K6 wrong", 0.01 <= abs(plain["K6"]) <= 0.25, plain["K6"])

velocity = figures["velocity"]
claim("overshoot of (67) is e^-2", near(velocity["continuous_overshoot"], math.exp(-2), 1e-4),
      velocity["continuous_overshoot"])
claim("and it settles in 68 ms", near(velocity["continuous_settling_s"], 0.068, 0.0005),
      velocity["continuous_settling_s"])
for entry, wanted in zip(velocity["delayed"], (0.149, 0.177, 0.247, 0.429)):
    claim(f"overshoot with {1000 * entry['delay_s']:.0f} ms", near(entry["paper_overshoot"], wanted, 6e-4),
          entry["paper_overshoot"])
    claim("ours does not", entry["overshoot"] < 0.005 and entry["settling_s"] <= 0.05, entry["settling_s"])
    claim("within its margins", entry["phase_margin_deg"] >= 45 and entry["sensitivity_peak"] <= 2,
          entry["phase_margin_deg"])
claim("1 % settling over CAN", 0 < velocity["chain_settling_s"] <= 0.05, velocity["chain_settling_s"])
claim("the paper's gains overshoot over CAN as predicted",
      near(velocity["chain_paper_overshoot"], velocity["chain_paper_predicted_overshoot"], 0.02),
      velocity["chain_paper_overshoot"])

eight = figures["figure_eight"]
claim("figure-8 RMS", 0 < eight["rms_m"] <= 0.005, eight["rms_m"])
claim("figure-8 peak", 0 < eight["peak_m"] <= 0.015, eight["peak_m"])
claim("torque stays within 5 Nm", 0 < eight["largest_torque_Nm"] <= 5.001, eight["largest_torque_Nm"])
claim("odometry alone is worse", eight["odometry_rms_m"] > 5 * eight["rms_m"], eight["odometry_rms_m"])
for entry in eight["paper_law"]:
    claim("the printed law ends in reverse", entry["literal_reverse_share"] > 0.9, entry["literal_reverse_share"])
    claim("the mirrored one drives forward", entry["mirrored_reverse_share"] < 0.1, entry["mirrored_reverse_share"])
    claim("neither follows as ours does", min(entry["literal_rms_m"], entry["mirrored_rms_m"]) > 10 * eight["rms_m"],
          entry["mirrored_rms_m"])

adaptation = figures["adaptation"]
for key in ("k7_relative_error", "k8_relative_error"):
    claim(f"adaptation {key}", abs(adaptation[key]) <= 0.05, adaptation[key])
identification = figures["identification"]
for key in ("k5", "k6", "k7", "k8"):
    error = identification[key + "_relative_error"]
    claim(f"{key} over CAN", abs(error) <= 0.02, error)
sys.exit(1 if failed else 0)
