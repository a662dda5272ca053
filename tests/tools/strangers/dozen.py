"""A dozen strangers' robots through the firmware as it is, a few with faults, and one of them again.

    dozen.py PROGRAM

Prints the tables. Fails when a command does not end as it should, when an aim that is demanded is missed (DEMANDED;
the aims themselves are in tools/strangers/report.cpp), and when the same robot, again by its number or from its two files
with `wheelwright sim`, is not identified as in the dozen.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

SEED = 1
COUNT = 12
FAULTS = 8  # each once
AGAIN = 4   # the number of the robot that is run again
# Healthy robots that were once called faulty: seed, number, what they were taken for.
MISJUDGED = ((442385866, 199, "an encoder that lies"), (94087110, 46, "a wheel in the air"), (2959479275, 173, "a wheel in the air"),
             (2176942132, 130, "a wheel in the air"), (2306339843, 34, "a wheel in the air"), (2546702790, 104, "an encoder that lies"),
             (2367965218, 91, "an encoder that lies"))
# A robot whose drives clip below the least torque limit that could be written: it was written larger, and a load misread.
WEAKEST = (1829799914, 107)
# Wheels in the air that once ended with no_room: pushed too quickly to be seen, as quick as the limit, and delay_not_found.
LIFTED = ((98766, 317), (98766, 509), (98765, 517))
# What must hold already, of the good robots and of those with faults.
DEMANDED = {
    "robots": ("problems", "wrong_successes"),
    "faults": ("problems", "wrong_successes"),
}
# Ends that say what is wrong; a robot whose drives clip goes on.
NAMED = {
    "swapped_wheels": {"wheels_swapped"},
    "wrong_sign": {"left_sign_wrong", "right_sign_wrong", "one_sign_wrong"},
    "wheel_in_air": {"left_wheel_off_ground", "right_wheel_off_ground"},
    "encoder_against_torque": {"left_wheel_against_torque", "right_wheel_against_torque"},
    "wheel_blocked": {"left_wheel_does_not_turn", "right_wheel_does_not_turn"},
    "too_heavy": {"too_heavy"},
    "no_room": {"no_room"},
}
AT_LEAST = {"identified_percent": 95, "steps_percent": 90, "figure_eight_percent": 90, "adaptation_percent": 90}  # of the good robots


def main():
    program = sys.argv[1]
    problems = []
    with tempfile.TemporaryDirectory() as scratch:
        figures = pathlib.Path(scratch, "figures.json")

        def run(*words, good=(0, 3)):
            done = subprocess.run([program, *map(str, words), "--json", str(figures)], capture_output=True, text=True, check=False)
            print(done.stdout, done.stderr, sep="")
            if done.returncode not in good:
                sys.exit(f"{words}: exit status {done.returncode}")
            return json.loads(figures.read_text(encoding="utf-8"))

        dozen = run("robots", "--seed", SEED, "--count", COUNT, "--page", pathlib.Path(scratch, "robots.html"))
        faults = run("robots", "--seed", SEED, "--count", FAULTS, "--faults")
        again = run("robots", "--seed", SEED, "--only", AGAIN, "--write", scratch)
        for seed, number, taken_for in MISJUDGED:
            end = run("robots", "--seed", seed, "--only", number)["identification"]["end"]
            if end != "good_enough":
                problems.append(f"robot {number} of seed {seed}, once taken for {taken_for}, ended with {end}")
        weakest = run("robots", "--seed", WEAKEST[0], "--only", WEAKEST[1])["driving"]
        for figure in ("loaded_k7", "loaded_k8", "unloaded_k7", "unloaded_k8"):
            error = weakest[f"{figure}_error_percent"]
            if not abs(error) <= 5:
                problems.append(f"robot {WEAKEST[1]} of seed {WEAKEST[0]}: {figure} {error} % off")
        for seed, number in LIFTED:
            end = run("robots", "--seed", seed, "--only", number, "--faults")["identification"]["end"]
            if end not in NAMED["wheel_in_air"]:
                problems.append(f"robot {number} of seed {seed}, a wheel in the air, ended with {end}")
        files = pathlib.Path(scratch, str(AGAIN))
        command = next(line for line in (files / "plant.toml").read_text(encoding="utf-8").splitlines() if "wheelwright sim" in line)
        seed = command.split("--seed ")[1].split()[0]
        replayed = run("sim", "--robot", files / "robot.toml", "--plant", files / "plant.toml", "--seed", seed, "ident")
        if subprocess.run([program, "check", str(files / "robot.toml")], check=False).returncode != 0:
            problems.append(f"`check` finds a problem in robot {AGAIN}'s file")

    if len(dozen["robots"]["robots"]) != COUNT or len(faults["robots"]["robots"]) != FAULTS:
        problems.append("robots are missing")
    if len({robot["fault"] for robot in faults["robots"]["robots"]}) != FAULTS:
        problems.append("some fault was not tried")
    for robot in faults["robots"]["robots"]:
        if robot["end"] not in NAMED.get(robot["fault"], {robot["end"]}):
            problems.append(f"robot {robot['robot']} with {robot['fault']} ended with {robot['end']}")
    for told, name in ((dozen, "robots"), (faults, "faults")):
        problems += [f"{name}: {aim} is {told['summary'][aim]}" for aim in DEMANDED[name] if told["summary"][aim] != 0]
    problems += [f"robots: {aim} is {dozen['summary'][aim]}, expected {least} at least"
                 for aim, least in AT_LEAST.items() if dozen["summary"][aim] < least]
    ident = next(section for key, section in replayed.items() if key.startswith("ident_"))
    first, second = again["identification"]["parameters"], ident["parameters"]
    errors = {row["name"]: row["standard_error"] for row in second}  # `sim` tells values as the robot file has them
    if any(row["standard_error"] != errors[row["name"]] for row in first):
        problems.append(f"robot {AGAIN} from its files: {second} instead of {first}")
    if dozen["robots"]["robots"][AGAIN - 1]["end"] != again["identification"]["end"]:
        problems.append(f"robot {AGAIN} alone ends otherwise than among the dozen")
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
