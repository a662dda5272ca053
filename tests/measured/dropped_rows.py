#!/usr/bin/env python3
"""What rows that are missing and stamps that are late do to an identification: EMPS with and without.

usage: dropped_rows.py WHEELWRIGHT DATA
"""
import json
import os
import random
import subprocess
import sys
import tempfile
import unittest


class DroppedRows(unittest.TestCase):
    program, data = sys.argv[1:3]

    def identify(self, log):
        out = log + ".json"
        run = subprocess.run([self.program, "ident", log, "--wheel-radius", "1", "--track", "1", "--json", out],
                             capture_output=True, text=True)
        self.assertIn(run.returncode, (0, 3), run.stderr)
        with open(out, encoding="utf-8") as file:
            found = json.load(file)
        figures = {row["parameter"]: row["value"] for row in found["dynamics"]["parameters"]}
        figures.update({row["effect"]: row["value"] for row in found["effects"]["parameters"]})
        notes = [row["note"] for row in found["notes"]["list"]]
        return {name: figures[name] for name in ("K7", "viscous_friction", "coulomb_friction")}, notes

    def test_emps(self):
        with open(os.path.join(self.data, "emps_id.csv"), encoding="utf-8") as file:
            head, *rows = file.read().split()
        with tempfile.TemporaryDirectory() as folder:
            log = os.path.join(folder, "log.csv")
            for dropped, late, within in ((0, 0, 0), (0.05, 0, 0.02), (0.2, 0, 0.04), (0.005, 0.2, 0.02)):
                draw = random.Random(1)
                kept = [row for row in rows if draw.random() >= dropped]
                stamps = [float(row.split(",")[0]) + 0.001 * late * draw.expovariate(1) for row in kept]
                with open(log, "w", encoding="utf-8") as file:
                    file.write("\n".join([head] + [f"{t:.6f},{row.partition(',')[2]}" for t, row in zip(stamps, kept)]) + "\n")
                found, notes = self.identify(log)
                print(f"{100 * dropped:4.1f} % dropped, stamps late by {late} steps in the mean: {found}; {notes}")
                if dropped == 0:
                    whole = found
                    self.assertEqual(notes, [])
                self.assertTrue(dropped == 0 or notes)
                for name, value in found.items():
                    self.assertAlmostEqual(value / whole[name], 1, delta=within + 1e-9, msg=name)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
