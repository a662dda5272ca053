"""Trials of an earlier campaign whose answers were sure and wrong, and what had made them so.

    once_wrong.py PROGRAM
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

PROGRAM = sys.argv[1]
SEED = 802218836


def judged(number):
    """The hidden and the named effects of a trial of the campaign on both plants."""
    with tempfile.TemporaryDirectory() as out:
        done = subprocess.run([PROGRAM, "gap-trials", "--campaign", "--plant", "both", "--seed", str(SEED), "--task",
                               str(number), "--no-stepwise", "--out", out], capture_output=True, text=True, timeout=280,
                              check=False)
        found = list(pathlib.Path(out, "results").glob("*.json"))
        assert len(found) == 1, done.stdout + done.stderr
        result = json.loads(found[0].read_text(encoding="utf-8"))
    names = lambda effects: sorted(effect["name"] for effect in effects)
    return names(result["truth"]["effects"]), result["finding"]["verdict"], names(result["finding"]["effects"])


class OnceWrong(unittest.TestCase):
    def named(self, numbers, effects):
        for number in numbers:
            with self.subTest(trial=number):
                self.assertEqual(judged(number), (effects, "named", effects))

    def test_unequal_radii_beside_unequal_friction_are_no_offset_of_the_centre_of_gravity(self):
        # nor, in the second, an offset and unequal gains
        self.named([1328, 1324, 3070], ["coulomb_friction", "wheel_radius_mismatch"])

    def test_a_late_report_is_no_lag_of_the_torque_because_the_gyro_is_noisy(self):
        self.named([1049, 2796], ["measurement_lag"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
