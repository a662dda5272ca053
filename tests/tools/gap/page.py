"""Writes a page of `wheelwright gap` for the browser's check. Usage: page.py PROGRAM ROBOTS FOLDER named|rivals"""
import os
import subprocess
import sys

PROGRAM, ROBOTS, FOLDER, CASE = sys.argv[1:]
EFFECT = {"named": "quadratic_drag]\ndrag_N_s2_per_m2 = 4.0\n",
          "rivals": "torque_bias]\nleft_Nm = 0.12\nright_Nm = 0.12\n"}[CASE]
DRIVES = {"named": ["ident", "velocity:1.3,-1,4", "velocity:-1.2,0.5,4", "velocity:1.6,0,4", "velocity:-1.6,0,4"],
          "rivals": [f"velocity:{sign * speed},0,1.5" for speed in (0.8, 0.3, 1.2, 0.6, 1.5, 0.4) for sign in (1, -1)]}[CASE]


def run(*arguments):
    done = subprocess.run([PROGRAM, *arguments], stdout=subprocess.DEVNULL, check=False)
    if done.returncode not in (0, 3):
        sys.exit(f"{arguments[0]} ended with {done.returncode}")


os.makedirs(FOLDER, exist_ok=True)
plant, model, log = os.path.join(FOLDER, "plant.toml"), os.path.join(ROBOTS, "default.toml"), os.path.join(FOLDER, "1.log")
with open(os.path.join(ROBOTS, "simulated.toml"), encoding="utf-8") as file:
    text = file.read()
with open(plant, "w", encoding="utf-8") as file:
    file.write(f"{text}\n[effects.{EFFECT}")
run("sim", "--robot", model, "--plant", plant, "--log", log, *DRIVES)
run("gap", log, "--model", model, "--out", FOLDER, *(["--close-loop", "--plant", plant] if CASE == "named" else []))
with open(os.path.join(FOLDER, "report.html"), encoding="utf-8") as file:
    page = file.read()
words = {"named": ["lacks quadratic_drag", "ruled out", "judged from here", "interval", "not in this log"],
         "rivals": ["What would tell", "wheelwright excite", "same in every motion"]}[CASE]
missing = [word for word in words if word not in page]
if missing:
    sys.exit(f"the page does not say: {missing}")
