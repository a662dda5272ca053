"""`wheelwright gap-trials` from outside, with an analyser of a few lines in place of `wheelwright gap`.

    command.py PROGRAM
"""
import csv
import json
import os
import pathlib
import re
import stat
import subprocess
import sys
import tempfile
import unittest

PROGRAM = sys.argv[1]

# Looks whether anybody left a label where it could be read, and answers what ANSWER says.
ANALYSER = f"""#!{sys.executable}
import json, os, pathlib, sys, time
if sys.argv[1:] == ["gap", "--help"]:
    sys.exit(0)
assert sys.argv[1] == "gap", sys.argv
log = pathlib.Path(sys.argv[2])
options = dict(zip(sys.argv[3::2], sys.argv[4::2]))
assert set(options) - {{"--without", "--model"}} == {{"--wheel-radius", "--track", "--out"}}, options
assert 0.07 < float(options["--wheel-radius"]) < 0.095 and 0.33 < float(options["--track"]) < 0.41
assert log.read_text().startswith("t_s,tau_left_Nm,")
labels = log.parent.parent / "labels" / (log.name.split(".")[0] + ".json")
assert not labels.exists(), "the label can be read"
answer = os.environ.get("ANSWER", "nothing_missing")
if answer == "crash":
    os.kill(os.getpid(), 11)
if answer == "sleep":
    time.sleep(100)
if answer == "silent":
    sys.exit(2)
pathlib.Path(options["--out"], "gap.json").write_text(json.dumps({{"verdict": answer, "effects": []}}))
print("seen", log, sys.argv)
"""


class Trials(unittest.TestCase):
    def setUp(self):
        self.scratch = tempfile.TemporaryDirectory()
        self.addCleanup(self.scratch.cleanup)
        self.folder = pathlib.Path(self.scratch.name)
        self.analyser = self.folder / "analyser"
        self.analyser.write_text(ANALYSER, encoding="utf-8")
        self.analyser.chmod(self.analyser.stat().st_mode | stat.S_IXUSR)
        self.out = self.folder / "trials"

    def run_trials(self, *arguments, answer="nothing_missing", analyser=None):
        command = [PROGRAM, "gap-trials", "--out", self.out, "--analyser", analyser or self.analyser, "--duration", 4,
                   *arguments]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=120, check=False,
                              env={**os.environ, "ANSWER": answer})
        return done.returncode, done.stdout, done.stderr

    def test_a_sample_is_judged_resumed_and_merged(self):
        figures = self.folder / "figures.json"
        status, out, err = self.run_trials("--sample", 6, "--seed", 3, "--jobs", 2, "--keep-logs", "--json", figures)
        self.assertEqual((status, err), (3, ""), out)  # who never finds anything misses the aim
        self.assertIn("A1", out)
        self.assertIn("nothing_missing", out)
        results = sorted((self.out / "results").iterdir())
        self.assertEqual(len(results), 6)
        self.assertEqual([path.name for path in results], [path.name for path in sorted((self.out / "labels").iterdir())])
        for path in (self.out / "logs").iterdir():
            with open(path, encoding="utf-8") as file:
                rows = list(csv.reader(file))
            self.assertEqual(rows[0][:5], ["t_s", "tau_left_Nm", "tau_right_Nm", "omega_left_rad_s", "omega_right_rad_s"])
            self.assertGreater(len(rows), 400)
        self.assertIn("seen", (self.out / "analyses" / results[0].stem / "output.txt").read_text(encoding="utf-8"))
        methods = {row["method"]: row["single"] for row in json.loads(figures.read_text(encoding="utf-8"))["methods"]["methods"]}
        self.assertEqual(methods["PySINDy, weak form"], "not measured")
        self.assertRegex(methods["stepwise BIC"], r"^(-|\d+/\d+)$")
        self.assertIn("Blind trials", (self.out / "report.html").read_text(encoding="utf-8"))
        run = json.loads(figures.read_text(encoding="utf-8"))
        self.assertEqual((run["run"]["done"], run["run"]["listed"], run["run"]["unanswered"]), (6, 6, 0))
        label = json.loads((self.out / "labels" / results[0].name).read_text(encoding="utf-8"))
        self.assertEqual(label["seed"], 3)
        self.assertIn("identifiable", label["oracle"])

        # Resuming runs only what is missing: with an analyser that would answer otherwise only one answer changes.
        results[2].unlink()
        status, out, _ = self.run_trials("--sample", 6, "--seed", 3, "--resume", answer="silent")
        self.assertEqual(status, 3)
        self.assertRegex(out, r"without an answer +1\n")
        # A task is the same trial as in the list, and merging finds it by name.
        names = {path.stem for path in results}
        status, out, _ = self.run_trials("--sample", 6, "--seed", 3, "--task", 0)
        self.assertEqual(status, 0)
        self.assertIn(out.split()[0], names)
        status, again, _ = self.run_trials("--sample", 6, "--seed", 3, "--task", 0, "--resume", answer="silent")
        self.assertEqual((status, again), (0, out))
        status, out, _ = self.run_trials("--sample", 6, "--seed", 3, "--merge")
        self.assertEqual(status, 3)
        self.assertRegex(out, r"done +6\n")

    def test_further_analyses_are_asked_resumed_and_merged(self):
        def further():
            found = {}
            for path in (self.out / "results").iterdir():
                result = json.loads(path.read_text(encoding="utf-8"))
                if result["asked_further"]:
                    found[path.stem] = (result["truth"], result.get("further", {}))
            return found
        trials = ("--sample", 12, "--seed", 3)
        self.run_trials(*trials, "--task", 0)
        self.run_trials(*trials, "--task", 1)
        self.assertEqual(further(), {})
        status, out, err = self.run_trials(*trials, "--further", 2, "--resume", "--keep-logs")
        self.assertEqual((status, err), (3, ""), out)
        asked = further()
        kinds = [truth["kind"] for truth, _ in asked.values()]
        every = [json.loads(path.read_text(encoding="utf-8"))["truth"]["kind"] for path in (self.out / "results").iterdir()]
        for kind in set(every):
            self.assertEqual(kinds.count(kind), (every.count(kind) + 1) // 2, kind)
        halved = [name for name, (truth, more) in asked.items() if "halves" in more]
        self.assertGreater(len(halved), 2)
        for name in halved:
            whole, first, second = (list(csv.reader((self.out / "logs" / f"{name}{part}.csv").read_text().splitlines()))
                                    for part in ("", ".halves-1", ".halves-2"))
            self.assertEqual(whole[1:], first[1:] + [[f"{float(row[0]) + len(first[1:]) * float(first[2][0]):.6f}", *row[1:]]
                                                     for row in second[1:]])
            self.assertEqual(second[1][0], "0.000000")
        held_out = {name: truth["effects"][0]["name"] for name, (truth, more) in asked.items() if "held_out" in more}
        self.assertTrue(held_out)
        for name, effect in held_out.items():
            seen = (self.out / "analyses" / f"{name}.held_out" / "output.txt").read_text(encoding="utf-8")
            self.assertRegex(seen, rf"'--without', '{effect}[,']")
            self.assertRegex(out, rf"{effect} +\w+ +nothing_missing +.*{name}")
        self.assertIn(f"{len(halved)} of all {len(halved)}", re.search(r"D3 halves.*", out)[0])  # always the same answer
        status, merged, _ = self.run_trials(*trials, "--further", 2, "--merge")
        self.assertEqual(re.findall(r"D3.*", merged), re.findall(r"D3.*", out))
        # nothing is asked again
        status, again, _ = self.run_trials(*trials, "--further", 2, "--resume", answer="silent")
        self.assertEqual(re.findall(r"D3.*", again), re.findall(r"D3.*", out))

    def test_whatever_the_analyser_does_is_an_outcome(self):
        for answer, said in (("crash", "ended by signal 11"), ("silent", "exit status 2"), ("sleep", "longer than"),
                             ("maybe", "no verdict")):
            status, _, err = self.run_trials("--sample", 1, "--task", 0, "--time-limit", 2, answer=answer)
            self.assertEqual((status, err), (3, ""), answer)
            result = json.loads(next((self.out / "results").iterdir()).read_text(encoding="utf-8"))
            self.assertEqual(result["finding"]["verdict"], "no_answer")
            self.assertIn(said, result["finding"]["problem"])

    def test_wrong_usage(self):
        def status(*arguments):
            done = subprocess.run([PROGRAM, "gap-trials", *map(str, arguments)], capture_output=True, text=True, timeout=60,
                                  check=False)
            self.assertNotEqual(done.stderr, "", arguments)
            self.assertLess(len(done.stderr.splitlines()[0]), 200)
            return done.returncode
        self.assertEqual(status(), 1)
        self.assertEqual(status("--out", self.out, "--plant", "moon"), 1)
        self.assertEqual(status("--out", self.out, "--sample", 0), 1)
        self.assertEqual(status("--out", self.out, "--further", -1), 1)
        self.assertEqual(status("--out", self.out, "--sample", 3, "--campaign"), 1)
        self.assertEqual(status("--out", self.out, "--sample", 3, "--task", 3), 1)
        self.assertEqual(status("--out", self.out, "--every-effect", "--campaign"), 1)
        self.assertEqual(status("--out", self.out, "--merge"), 2)
        self.assertEqual(status("--out", self.out, "--analyser", "/nowhere"), 4)
        self.assertEqual(status("--out", self.out, "--analyser", "/bin/false"), 4)
        self.assertEqual(status("--out", self.out, "--analyser", self.analyser, "--pysindy", self.folder), 4)
        self.assertEqual(status("--out", self.out, "--stepwise-bic", self.analyser), 1)
        blocked = self.folder / "file"
        blocked.write_text("", encoding="utf-8")
        self.assertEqual(status("--out", blocked / "x", "--analyser", self.analyser), 4)

    def test_the_campaign_is_all_that_was_promised(self):
        done = subprocess.run([PROGRAM, "gap-trials", "--campaign", "--list"], capture_output=True, text=True, timeout=60,
                              check=True)
        # 24 effects x 3 sizes x 3 noises x 5; 16 pairs x 10; 300 with nothing; 2 faults x 3 x 3 x 5; 12 blind x 10
        self.assertEqual(int(done.stdout), 24 * 45 + 160 + 300 + 90 + 120)
        done = subprocess.run([PROGRAM, "gap-trials", "--every-effect", "--list"], capture_output=True, text=True, timeout=60,
                              check=True)
        self.assertEqual(int(done.stdout), 24 + 4 + 4 + 2 + 4)  # single, pairs, nothing, faults, blind


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]])
