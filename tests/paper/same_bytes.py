#!/usr/bin/env python3
"""The same seed gives the same page and the same figures, another seed others: same_bytes.py PROGRAM FOLDER
(FOLDER and FOLDER.json: what a first run with --quick wrote)."""
import pathlib
import subprocess
import sys
import tempfile

program, first = sys.argv[1], pathlib.Path(sys.argv[2])


def run(*more):
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([program, "paper", "--quick", "--out", folder, "--json", folder + "/figures.json", *more],
                       check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        base = pathlib.Path(folder)
        return (base / "index.html").read_bytes(), (base / "figures.json").read_bytes()


again = run()
wanted = (first / "index.html").read_bytes(), first.with_name(first.name + ".json").read_bytes()
if again != wanted:
    sys.exit("the same seed gave other bytes")
if run("--seed", "2")[1] == wanted[1]:
    sys.exit("another seed gave the same figures")
print(f"{len(again[0])} bytes of page and {len(again[1])} of figures, twice the same")
