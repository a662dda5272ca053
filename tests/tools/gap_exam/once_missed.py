"""Robots of the exam whose further effect was not named, or another for it, and what had made it so.

    once_missed.py PROGRAM
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

PROGRAM = sys.argv[1]


def named(seed, number):
    """The effects that are named on a log of the exam, with their rivals."""
    with tempfile.TemporaryDirectory() as out:
        subprocess.run([PROGRAM, "gap-exam", "--seed", str(seed), "--log", str(number), "--out", out],
                       capture_output=True, text=True, timeout=120, check=False)
        found = json.loads(pathlib.Path(out, str(number), "gap", "gap.json").read_text(encoding="utf-8"))
    return {effect["name"]: [rival["name"] for rival in effect["rivals"]] for effect in found["effects"]}


class OnceMissed(unittest.TestCase):
    def test_what_a_sensor_shows_is_not_the_first_effect(self):
        self.assertIn("payload_step", named(1308892933, 293))

    def test_few_pieces_make_an_interval_wide_but_not_a_load_doubtful(self):
        self.assertIn("gain_drift", named(3074510771, 216)["payload_step"])

    def test_a_closer_evaluation_does_not_lose_a_limit_that_falls_with_the_speed(self):
        self.assertIn("back_emf_limit", named(2272987015, 31))

    def test_friction_moves_no_load(self):
        self.assertIn("payload_step", named(3467140695, 237))

    def test_speeds_are_not_later_than_a_gyro_allows(self):
        effects = named(1308892933, 37)
        self.assertIn("actuator_lag", effects)
        self.assertNotIn("measurement_lag", effects["actuator_lag"])

    def test_without_a_gyro_a_lag_of_the_torque_may_be_one_of_the_report(self):
        effects = named(2718281829, 15)
        self.assertIn("measurement_lag", effects["actuator_lag"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
