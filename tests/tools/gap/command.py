"""`wheelwright gap` from outside, on candump logs that `wheelwright sim` wrote; and in the demo. Usage: command.py PROGRAM ROBOTS"""
import json
import os
import random
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
        if run_["before"] is not None:  # without friction some runs leave all bounds
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

    def test_an_effect_that_is_known_not_to_be_there_is_not_looked_for(self):
        log = self.simulate(self.plant(self.COULOMB), "c.log", "ident")
        known = ["coulomb_friction", "stribeck_friction"]
        found, out = self.gap(log, "--model", self.model, "--without", ",".join(known))
        self.assertEqual(found["without"], known)
        self.assertIn("not looked for, as was asked: coulomb_friction, stribeck_friction", out)
        spoken_of = json.dumps([found["effects"], found["advice"], found["detectable"]])
        for name in known:
            self.assertNotIn(name, spoken_of)
        self.assertIn("quadratic_drag", spoken_of)
        for names, words in (("coulomb_frction", "did you mean coulomb_friction?"), ("slope,moon", "The effects are"),
                             ("", "no effect has this name")):
            status, _, err = run("gap", log, "--model", self.model, "--out", self.path("gap"), "--without", names)
            self.assertEqual(status, 1, err)
            self.assertIn(words, err)
            self.assertLess(len(err.splitlines()[0]), 120)
        status, _, err = run("gap", log, "--model", os.path.join(ROBOTS, "default.toml"), "--out", self.path("gap"),
                             "--without", "viscous_friction")
        self.assertEqual(status, 1, err)
        self.assertIn("the model given has it", err)

    def test_a_heldout_log_that_is_learned_from_is_refused(self):
        rows = "t_s,tau_left_Nm\n0,0\n"
        log, copy = self.write("one.csv", rows), self.write("copy.csv", rows)
        link = self.path("link.csv")
        if not os.path.exists(link):
            os.symlink(log, link)
        tests = self.write("sysid.json", "{}")
        for learned, heldout, refused in ((log, log, True), (log, copy, True), (log, link, True),
                                          (tests, tests + ":slow", True), (tests + ":slow", tests, True),
                                          (tests + ":slow", tests + ":slow", True),
                                          (tests + ":slow", tests + ":fast", False),
                                          (log, self.write("other.csv", rows + "1,0\n"), False)):
            status, _, err = run("gap", self.write("more.csv", rows + "2,0\n"), learned, "--heldout", heldout, "--out",
                                 self.path("gap"))
            self.assertEqual(status == 1 and "the same log is learned from" in err, refused, (learned, heldout, err))

    def test_torque_that_slows_and_speeds_that_are_noise_are_told_apart(self):
        # A robot of 1.1 rad/s^2 a Nm at its wheels, in steps of torque both ways; wheels a little unlike.
        def problem(sign, noise_rad_per_s):
            random.seed(7)
            rows, speed = ["t_s,tau_left_Nm,tau_right_Nm,omega_left_rad_s,omega_right_rad_s"], [0.0, 0.0]
            for i in range(4000):
                torque = [0.9 * (-1) ** (i // 90 % 2 + i // 370), 0.8 * (-1) ** (i // 110 % 2 + i // 290)]
                seen = [one + random.gauss(0, noise_rad_per_s) for one in speed]
                rows.append(",".join(f"{x:.6g}" for x in (0.01 * i, sign * torque[0], sign * torque[1], *seen)))
                speed = [v + 0.01 * (1.1 * t - 0.8 * v) for v, t in zip(speed, torque)]
            log = self.write("robot.csv", "\n".join(rows) + "\n")
            status, _, err = run("gap", log, "--wheel-radius", "0.08", "--track", "0.4", "--out", self.path("gap"))
            self.assertEqual(status, 2 if sign < 0 or noise_rad_per_s > 1 else 0, err)
            return err
        self.assertNotIn("torque", problem(1, 0.001))
        self.assertIn("forward torque slows the robot down: is the sign of torque or speed wrong?", problem(-1, 0.001))
        self.assertIn("what forward torque does is lost in the speeds' noise", problem(1, 20))

    def test_without_a_model_a_candump_log_is_refused(self):
        log = self.write("x.log", "(1.000000) can0 02E#0000000000000000\n")
        status, _, err = run("gap", log, "--out", self.path("gap"))
        self.assertEqual(status, 1)
        self.assertIn("needs --model", err)
        status, _, err = run("gap", log, "--model", self.model, "--out", self.path("gap"))
        self.assertEqual(status, 2, err)


class Advice(Rig):
    BIAS = "\n[effects.torque_bias]\nleft_Nm = 0.12\nright_Nm = 0.12\n"

    def setUp(self):
        super().setUp()
        self.model = os.path.join(ROBOTS, "default.toml")  # friction is known to exist, and fitted anew
        with open(os.path.join(ROBOTS, "simulated.toml"), encoding="utf-8") as file:
            self.biased = self.write("plant.toml", file.read() + self.BIAS)

    def excite(self, advice, *arguments):
        return run("excite", "--advice", advice, "--robot", self.path("gap/robot.extended.toml"), *arguments)

    def tell_apart(self, plant, seed):
        """Straight on, a bias and a slope do the same; then the advised motion is driven. Both findings."""
        straight = [f"velocity:{sign * speed},0,1.5" for speed in (0.8, 0.3, 1.2, 0.6, 1.5, 0.4) for sign in (1, -1)]
        first = self.simulate(plant, "1.log", *straight, seed=seed)
        found, out = self.gap(first, "--model", self.model)
        self.assertEqual([{a["tell"], a["from"]} for a in found["advice"]], [{"torque_bias", "slope"}], out)
        self.assertGreater(found["advice"][0]["torque_Nm"], 0)
        status, out, err = self.excite(self.path("gap/gap.json"), "--plant", plant, "--log", self.path("2.log"),
                                       "--json", self.path("excite.json"))
        self.assertEqual(status, 0, err)
        with open(self.path("excite.json"), encoding="utf-8") as file:
            motion = json.load(file)["motion"]
        self.assertEqual(motion["name"], found["advice"][0]["name"])
        self.assertLess(motion["speed_m_per_s"], 2.5)  # the robot file's limit
        found, out = self.gap(first, self.path("2.log"), "--model", self.model)
        self.assertEqual(found["verdict"], "named", out)
        return {e["name"]: {p["name"]: p["value"] for p in e["parameters"]} for e in found["effects"]}

    def test_what_one_log_cannot_tell_the_advised_motion_tells(self):
        for seed in (1, 2):
            found = self.tell_apart(self.biased, seed)
            self.assertEqual(list(found), ["torque_bias"])
            for value in found["torque_bias"].values():
                self.assertAlmostEqual(value, 0.12, delta=0.02 * 0.12)

    def test_and_so_for_the_rival(self):
        with open(os.path.join(ROBOTS, "simulated.toml"), encoding="utf-8") as file:
            hill = self.write("hill.toml", file.read() + "\n[effects.slope]\nangle_rad = 0.03\nuphill_rad = 0.0\n")
        for seed in (1, 2):
            found = self.tell_apart(hill, seed)
            self.assertEqual(list(found), ["slope"])
            self.assertAlmostEqual(found["slope"]["angle_rad"], 0.03, delta=0.1 * 0.03)

    def advice(self, **values):
        return self.write("advice.json", json.dumps({"advice": [{"tell": "a", "from": "b", **values}]}))

    def test_a_motion_that_runs_away_is_ended_before_the_robot_is_too_fast(self):
        os.mkdir(self.path("gap"))
        self.write("gap/robot.extended.toml", without_effects("default.toml"))
        # downhill, which this model does not know
        plant = self.plant("\n[effects.slope]\nangle_rad = 0.05\nuphill_rad = 3.14\n")
        status, _, err = self.excite(self.advice(name="coast", torque_Nm=0.5), "--plant", plant, "--log",
                                     self.path("x.log"), "--rounds", 2)
        self.assertEqual((status, err), (0, ""))

    def test_wrong_advice_is_refused(self):
        os.mkdir(self.path("gap"))
        self.write("gap/robot.extended.toml", without_effects("default.toml"))
        to = ("--plant", self.biased, "--log", self.path("x.log"))
        for advice, words in ((self.path("none.json"), "cannot be read"), (self.write("x.json", "{"), "no gap.json"),
                              (self.write("y.json", '{"advice": []}'), "nothing to tell apart"),
                              (self.advice(name="waltz", torque_Nm=1), "no motion of this version"),
                              (self.advice(name="creep", torque_Nm=-1), "no motion of this version")):
            status, _, err = self.excite(advice, *to)
            self.assertEqual(status, 2, err)
            self.assertIn(words, err)
        good = self.advice(name="creep", torque_Nm=1)
        self.assertEqual(self.excite(good, *to, "--which", 2)[0], 1)
        self.assertEqual(self.excite(good)[0], 1)
        self.assertEqual(self.excite(good, *to, "--can", "nocan7")[0], 1)
        self.assertEqual(self.excite(good, "--can", "nocan7", "--yes")[0], 4)


class CloseLoop(Rig):
    DRAG = "\n[effects.quadratic_drag]\ndrag_N_s2_per_m2 = 4.0\n"
    DRIVES = ("ident", "velocity:0.8,0,1.5", "velocity:-0.6,1.5,1.5", "velocity:1.3,-1,2", "velocity:-1.2,0.5,2",
              "velocity:0.9,-2,1.5", "velocity:1.6,0,2", "velocity:-1.6,0,2")

    def setUp(self):
        super().setUp()
        self.model = os.path.join(ROBOTS, "default.toml")
        with open(os.path.join(ROBOTS, "simulated.toml"), encoding="utf-8") as file:
            self.dragged = self.write("plant.toml", file.read() + self.DRAG)
        self.log = self.simulate(self.dragged, "1.log", *self.DRIVES, seed=1)

    def test_the_figure_8_comes_down_to_that_of_a_controller_that_knows_the_truth(self):
        found, out = self.gap(self.log, "--model", self.model, "--close-loop", "--plant", self.dragged)
        self.assertEqual([e["name"] for e in found["effects"]], ["quadratic_drag"], out)
        self.assertTrue(found["closed_loop"]["truth_known"])
        drive = found["closed_loop"]["figure_eight"]
        self.assertLess(drive["after"]["rms_m"], drive["nominal"]["rms_m"])
        self.assertLess(drive["after"]["rms_m"], 1.02 * drive["truth"]["rms_m"])
        self.assertLess(drive["after"]["peak_m"], 1.05 * drive["truth"]["peak_m"])
        self.assertIn("after, with what was found", out)
        with open(self.path("gap/robot.extended.toml"), encoding="utf-8") as file:
            self.assertIn("[effects.quadratic_drag]", file.read())

    def test_without_a_plant_it_says_whose_figure_8_it_is(self):
        found, out = self.gap(self.log, "--model", self.model, "--close-loop")
        self.assertFalse(found["closed_loop"]["truth_known"])
        self.assertIn("no truth is known", out)
        self.assertLess(found["closed_loop"]["figure_eight"]["after"]["rms_m"], 0.005)

    def test_wrong_usage(self):
        for arguments in (("--plant", self.dragged), ("--can", "can0"), ("--close-loop", "--plant", "nowhere.toml")):
            status, _, err = run("gap", self.log, "--model", self.model, "--out", self.path("gap"), *arguments)
            self.assertEqual(status, 1, err)
        self.assertEqual(run("gap", self.log, "--model", self.model, "--out", self.path("gap"), "--close-loop", "--can",
                             "nocan7", "--yes")[0], 4)


class Demo(Rig):
    def test_the_demo_ends_with_an_effect_that_it_hides_and_finds(self):
        # seeds that draw different effects
        drawn = set()
        for seed in (1, 2, 3, 6):
            status, out, err = run("demo", "--seed", seed, "--out", self.folder.name, "--json", self.path("demo.json"))
            self.assertEqual((status, err), (0, ""), out)
            with open(self.path("demo.json"), encoding="utf-8") as file:
                hidden = json.load(file)["hidden_effect"]
            drawn.add(hidden["named"])
            for row in hidden["parameters"]:
                self.assertLess(abs(row["value"] - row["true_value"]), 3.3 * row["standard_error"], row)
            self.assertLess(hidden["figure_eight_after_mm"], hidden["figure_eight_given_mm"])
            self.assertLess(hidden["figure_eight_after_mm"], 1.05 * hidden["figure_eight_truth_mm"])
        self.assertEqual(len(drawn), 4, drawn)
        with open(self.path("index.html"), encoding="utf-8") as file:
            self.assertIn("What the model lacks", file.read())
        self.assertGreater(os.path.getsize(self.path("gap/report.html")), 100_000)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
