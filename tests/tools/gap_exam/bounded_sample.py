#!/usr/bin/env python3
"""`wheelwright gap-exam` on a few logs: every log gets an answer, a log is the same by itself, the figures belong together.

    bounded_sample.py PROGRAM

Prints the exam's own table. Its aims are not judged here: a dozen logs say too little, and the exam is made to be harder
than what the analysis can do today.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

SEED = 20261124
COUNT = 10
ALONE = 7
VERDICTS = {"named", "nothing_missing", "cannot_tell", "unexplained", "unusable_log"}


def hold(program, out, *options):
    figures = out / "figures.json"
    done = subprocess.run([program, "gap-exam", "--seed", str(SEED), *options, "--out", str(out), "--json", str(figures)],
                          capture_output=True, text=True, check=False)
    print(done.stdout, done.stderr, sep="")
    told = json.loads(figures.read_text(encoding="utf-8"))
    met = all(aim["reached"] for aim in told["aims"]["list"])
    if done.returncode != (0 if met else 3):
        sys.exit(f"exit status {done.returncode} although the aims were {'reached' if met else 'missed'}")
    return told


def problems_of(program, scratch):
    told = hold(program, scratch / "all", "--count", str(COUNT), "--jobs", "2")
    logs = told["logs"]["list"]
    if [log["log"] for log in logs] != list(range(1, COUNT + 1)):
        yield "not every log is listed"
    for log in logs:
        folder = scratch / "all" / str(log["log"])
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        if not 1 <= truth["robot"]["mass_kg"] <= 200 or not truth["sizes"]["dry"]["share"] > 0:
            yield f"log {log['log']}: no robot of the exam: {truth}"
        if log["verdict"] == "refused":
            yield f"log {log['log']}: no answer: {told.get('refusals')}"
            continue
        answer = json.loads((folder / "gap" / "gap.json").read_text(encoding="utf-8"))
        if answer["verdict"] not in VERDICTS or answer["verdict"] != log["verdict"]:
            yield f"log {log['log']}: verdict {answer['verdict']}, listed {log['verdict']}"
    hold(program, scratch / "one", "--log", str(ALONE))
    for name in ("learned.csv", "held_out.csv", "truth.json"):
        if (scratch / "all" / str(ALONE) / name).read_bytes() != (scratch / "one" / str(ALONE) / name).read_bytes():
            yield f"log {ALONE} by itself is another: {name}"
    refused = subprocess.run([program, "gap-exam", "--analyser", "/bin/false"], capture_output=True, text=True, check=False)
    if refused.returncode != 1 or "/bin/false gap --help does not end well" not in refused.stderr:
        yield f"an analyser that is none: exit status {refused.returncode}, {refused.stderr}"


def main():
    with tempfile.TemporaryDirectory() as scratch:
        problems = list(problems_of(sys.argv[1], pathlib.Path(scratch)))
    for problem in problems:
        print(problem)
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
