"""`wheelwright gap` from outside, on candump logs that `wheelwright sim` wrote. Usage: command.py PROGRAM ROBOTS"""
import json
import os
import re
import subprocess
import sys
import tempfile
import unittest

PROGRAM, ROBOTS = sys.argv[1], sys.argv[2]


def run(*arguments, timeout=120):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=timeout)
    return done.returncode, done.stdout, done.stderr


def without_effects(name):
    """The text of an example robot without its tables of effects."""
    with open(os.path.join(ROBOTS, name), encoding="utf-8") as file:
        return re.sub(r"^\[effects\.[^\[]*", "", file.read(), flags=re.M)


class Rig(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.model = self.write("model.toml", without_effects("default.toml"))

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def write(self, name, text):
        with open(self.path(name), "w", encoding="utf-8") as file:
            file.write(text)
        return self.path(name)

    def plant(self, effects):
        return self.write("plant.toml", without_effects("simulated.toml") + effects)

    def simulate(self, plant, log, *actions, seed=3):
        status, _, err = run("sim", "--robot", self.model, "--plant", plant, "--log", self.path(log), "--seed", seed,
                             *actions)
        self.assertIn(status, (0, 3), err)
        return self.path(log)

    def gap(self, *arguments):
        status, out, err = run("gap", *arguments, "--out", self.path("gap"))
        self.assertEqual(status, 0, err)
        with open(self.path("gap/gap.json"), encoding="utf-8") as file:
            return json.load(file), out


class Candump(Rig):
    COULOMB = "\n[effects.coulomb_friction]\nleft_Nm = 0.31\nright_Nm = 0.24\n"

    def test_friction_that_the_model_lacks_is_named_from_a_log_of_the_bus(self):
        log = self.simulate(self.plant(self.COULOMB), "c.log", "ident")
        found, out = self.gap(log, "--model", self.model)
        self.assertEqual(found["verdict"], "named", out)
        self.assertEqual([e["name"] for e in found["effects"]], ["coulomb_friction"])
        value = {p["name"]: p["value"] for p in found["effects"][0]["parameters"]}
        # the drives' torque constants are half a per cent off, and so are the wheels' radii
        self.assertAlmostEqual(value["left_Nm"], 0.31, delta=0.02 * 0.31)
        self.assertAlmostEqual(value["right_Nm"], 0.24, delta=0.02 * 0.24)
        run_ = found["heldout"]["wheel_speed_rms_rad_s"]
        self.assertGreater(run_["before"], 20 * run_["after"])
        self.assertLess(run_["after"], 2 * run_["floor"])
        # one delay, one age: the drives' torque comes neither early nor late
        self.assertLess(abs(found["log"]["torque_acts_late_samples"][0]), 0.1)
        self.assertEqual(found["log"]["rate_Hz"], 250)

    def test_two_logs_are_one_experiment(self):
        plant = self.plant(self.COULOMB)
        logs = [self.simulate(plant, f"{i}.log", "--duration", 25, "ident", seed=i) for i in (1, 2)]
        found, out = self.gap(*logs, "--model", self.model)
        self.assertEqual([e["name"] for e in found["effects"]], ["coulomb_friction"], out)
        self.assertLess(found["heldout"]["duration_s"], 6)

    def test_a_stretch_in_which_drives_are_not_heard_is_left_out_and_said(self):
        log = self.simulate(self.plant(self.COULOMB), "c.log", "ident")
        with open(log, encoding="utf-8") as file:
            lines = file.readlines()
        kept = [line for number, line in enumerate(lines)
                if not 0.4 < number / len(lines) < 0.45 or " 029#" not in line]  # node 1, encoder estimates
        self.write("gap.log", "".join(kept))
        found, out = self.gap(self.path("gap.log"), "--model", self.model)
        self.assertEqual([e["name"] for e in found["effects"]], ["coulomb_friction"], out)
        self.assertTrue(any("no encoder frames" in note for note in found["log"]["notes"]), found["log"])

    def test_without_a_model_a_candump_log_is_refused(self):
        log = self.write("x.log", "(1.000000) can0 02E#0000000000000000\n")
        status, _, err = run("gap", log, "--out", self.path("gap"))
        self.assertEqual(status, 1)
        self.assertIn("needs --model", err)
        status, _, err = run("gap", log, "--model", self.model, "--out", self.path("gap"))
        self.assertEqual(status, 2, err)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
