"""tools/gap_trials/slurm_array on a Slurm of one node: the same results as without Slurm, merged by name.

    slurm.py PROGRAM ROOT
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

from private_slurm import PrivateSlurm

PROGRAM, ROOT = sys.argv[1], pathlib.Path(sys.argv[2])
ARRAY = ROOT / "tools/gap_trials/slurm_array"
TRIALS = ["--sample", "6", "--seed", "3", "--duration", "12", "--keep-logs"]


def run(*command, environment=None):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=280, check=False,
                          env=environment)
    return done.returncode, done.stdout + done.stderr


def results(out):
    """By name, without what a clock says."""
    found = {}
    for path in sorted((out / "results").iterdir()):
        result = json.loads(path.read_text(encoding="utf-8"))
        for finding in (result["finding"], *result["beside"].values()):
            del finding["seconds"], finding["memory_bytes"]
        found[path.stem] = result
    return found


class JobArrays(unittest.TestCase):
    def test_an_array_gives_what_one_process_gives(self):
        with tempfile.TemporaryDirectory() as scratch:
            folder = pathlib.Path(scratch).resolve()
            folder.chmod(0o755)  # munge's socket must be open to all
            alone, array = folder / "alone", folder / "with space"
            alone_status, alone_text = run(PROGRAM, "gap-trials", *TRIALS, "--out", alone, "--json", folder / "alone.json")
            self.assertEqual(len(results(alone)), 6, alone_text)

            # Six tasks in arrays of at most four.
            slurm = PrivateSlurm(folder / "slurm", largest_array=4)
            with slurm:
                status, text = run(ARRAY, "trials", "--program", PROGRAM, *TRIALS, "--out", array, "--json",
                                   folder / "array.json", environment=slurm.environment)
                self.assertEqual(status, alone_status, text + slurm.logs())
                self.assertRegex(text, r"6 tasks in 2 job array\(s\)")
                self.assertRegex(text, r"done +6\n")
                self.assertEqual(len(list((array / "slurm").iterdir())), 6)
                self.assertEqual(results(array), results(alone))
                figures = [json.loads((folder / name).read_text(encoding="utf-8")) for name in ("alone.json", "array.json")]
                for each in figures:
                    for key in ("seconds", "memory_MiB"):
                        del each["run"][key]
                    for row in each["methods"]["methods"]:
                        del row["seconds"]
                self.assertEqual(figures[0], figures[1])
                for kind in ("logs", "labels"):
                    names = sorted(path.name for path in (alone / kind).iterdir())
                    self.assertEqual(len(names), 6)
                    for name in names:
                        self.assertEqual((alone / kind / name).read_bytes(), (array / kind / name).read_bytes(), name)

                # Resuming runs only what is missing.
                gone, kept = sorted((array / "results").iterdir())[:2]
                gone.unlink()
                before = kept.stat().st_mtime_ns
                status, text = run(ARRAY, "trials", "--program", PROGRAM, *TRIALS, "--out", array, "--resume",
                                   environment=slurm.environment)
                self.assertEqual(status, alone_status, text)
                self.assertEqual(results(array), results(alone))
                self.assertEqual(kept.stat().st_mtime_ns, before)

                # Logs by themselves; one of them is none.
                logs = sorted((alone / "logs").iterdir())[:2]
                broken = folder / "broken.csv"
                broken.write_text("nonsense\n", encoding="utf-8")
                status, text = run(ARRAY, "logs", "--program", PROGRAM, "--out", folder / "answers", *logs, broken, "--",
                                   "--wheel-radius", "0.083", "--track", "0.37", environment=slurm.environment)
                answers = json.loads((folder / "answers/merged.json").read_text(encoding="utf-8"))
                self.assertEqual(sorted(answers), sorted(path.stem for path in [*logs, broken]), text)
                for log in logs:
                    _, _ = run(PROGRAM, "gap", log, "--out", folder / "one", "--wheel-radius", "0.083", "--track", "0.37")
                    told = json.loads((folder / "one/gap.json").read_text(encoding="utf-8"))
                    self.assertEqual(answers[log.stem]["verdict"], told["verdict"])
                    self.assertEqual(answers[log.stem]["effects"], told["effects"])
                self.assertIn(answers["broken"]["verdict"], ("no_answer", "unusable_log"))
                self.assertEqual(status, 3 if answers["broken"]["verdict"] == "no_answer" else 0, text)
            deadline = time.monotonic() + 20
            while slurm.processes() and time.monotonic() < deadline:
                time.sleep(0.2)
            self.assertEqual(slurm.processes(), [])

    def test_wrong_usage(self):
        for words, expected in (([], 1), (["trials"], 1), (["logs", "--out", "x"], 1), (["trials", "--out", "x", "--merge"], 1),
                                (["trials", "--out", "x", "--program", "/nowhere"], 4)):
            with tempfile.TemporaryDirectory() as scratch:
                done = subprocess.run([ARRAY, *words], cwd=scratch, capture_output=True, text=True, timeout=60, check=False)
                self.assertEqual(done.returncode, expected, done)
                self.assertNotEqual(done.stderr, "")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]])
