#!/usr/bin/env python3
"""A folder that cannot be made is said in one sentence, with status 4; a missing option with status 1."""
import subprocess
import sys
import tempfile

with tempfile.NamedTemporaryFile() as file:
    run = subprocess.run([sys.argv[1], "paper", "--quick", "--out", file.name + "/below"], capture_output=True,
                         text=True, check=False)
last = run.stderr.strip().splitlines()[-1]
print(run.returncode, last)
if run.returncode != 4 or file.name not in last:
    sys.exit("wanted status 4 and the folder's name")
run = subprocess.run([sys.argv[1], "paper"], capture_output=True, text=True, check=False)
if run.returncode != 1 or "--out" not in run.stderr:
    sys.exit(f"without --out: status {run.returncode}, {run.stderr}")
