"""The README's way to a robot that drives, on a real bus and with the programs that it names: check the file, look at
the signs, stop, identify, save, drive; and the log of it, read afterwards. One robot; the cases are the steps in their
order, and each needs the one before."""
import json
import re
import signal
import subprocess
import time
import tomllib
import unittest

import rig
from drive import as_seen_with


def run(*arguments, seconds=rig.LONG):
    done = subprocess.run([rig.wheelwright(), *arguments], capture_output=True, text=True, timeout=seconds, check=False)
    return done.returncode, done.stdout, done.stderr


def ctl(*arguments, seconds=rig.LONG):
    return run("ctl", "--can", "vcan0", *arguments, seconds=seconds)


class Workbench(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.rig = rig.Rig()
        cls.addClassCleanup(cls.rig.end)
        cls.rig.start_robot()
        cls.log = cls.rig.file("drive.log")
        # As the README says: a copy without [dynamics], and a watchdog that nobody has tried yet.
        cls.rig.write_robot_file(drive__watchdog_assured=False)
        cls.rewrite(lambda text: re.sub(r"^\[dynamics\]\n(?:\w.*\n)*", "", text, flags=re.M))

    @classmethod
    def rewrite(cls, edit):
        with open(cls.rig.robot_file, encoding="utf-8") as file:
            text = file.read()
        assert edit(text) != text
        with open(cls.rig.robot_file, "w", encoding="utf-8") as file:
            file.write(edit(text))

    def test_1_the_robot_file_is_checked(self):
        status, out, err = run("check", self.rig.robot_file)
        self.assertEqual((status, err), (0, ""))
        for words in ("K7 and K8 are not given: velocity, pose, trajectory and adaptive are refused", "arming will be refused"):
            self.assertIn(words, out)

    def test_2_nothing_arms_before_the_watchdog_is_assured(self):
        self.rig.launch_daemon()
        status, out, err = ctl("torque", "0.1", "0.1", "--enter", "--for", "5")
        self.assertEqual((status, out), (3, ""))
        self.assertIn("did not enter torque: state fault, fault arming_refused, blocked by watchdog_not_confirmed", err)
        status, out, err = run("monitor", "--can", "vcan0", "--for", "0.2")
        self.assertEqual((status, err), (0, ""))
        self.assertIn("fault arming_refused blocked by watchdog_not_confirmed", out)
        self.assertEqual(self.rig.stop_daemon(), 0)
        self.rewrite(lambda text: re.sub(r"^(watchdog_assured\s*=\s*)false", r"\1true", text, flags=re.M))

    def test_3_signs(self):
        self.rig.launch_daemon()
        began = time.time()
        self.assertEqual(ctl("torque", "0.1", "0.1", "--enter", "--for", "0.5"), (0, "", ""))
        self.rig.until_state("idle")
        self.assertEqual({abs(row[4]) < 1e-3 for row in self.rig.truth(began)}, {True})  # friction holds the wheels
        began = time.time()
        self.assertEqual(ctl("torque", "0.5", "0.5", "--enter", "--for", "0.5"), (0, "", ""))
        wheels = [rig.DBC.decode(rig.number_of("WheelState"), data) for _, data in self.rig.host.of("WheelState", began)]
        for speed in ("LeftSpeed", "RightSpeed"):
            self.assertGreater(max(wheel[speed] for wheel in wheels), 0.5)  # rad/s
            self.assertGreater(min(wheel[speed] for wheel in wheels), -0.1)
        self.assertGreater(max(row[4] for row in self.rig.truth(began)), 0.04)
        self.rig.until_state("idle")
        self.rig.until(self.rig.at_rest, "the robot stands")

    def test_4_stop_and_clear(self):
        process = subprocess.Popen([rig.wheelwright(), "ctl", "--can", "vcan0", "torque", "0.5", "0.5", "--enter"],
                                   stderr=subprocess.PIPE, text=True)
        self.rig.until(lambda: self.rig.truth()[4] > 0.05, "the wheels turn")
        self.assertEqual(ctl("stop"), (0, "state fault, fault emergency_stop_message\n", ""))
        self.assertEqual(process.wait(rig.LONG), 3)
        self.assertIn("has left torque: state fault, fault emergency_stop_message", process.stderr.read())
        process.stderr.close()
        self.rig.until(self.rig.at_rest, "the robot stands")
        self.assertEqual(ctl("clear"), (0, "state idle\n", ""))

    def test_5_identify_and_save(self):
        status, out, err = ctl("mode", "adaptive")
        self.assertEqual((status, out), (3, ""))
        self.assertIn("blocked by not_identified", err)
        type(self).record = subprocess.Popen([rig.wheelwright(), "record", "--can", "vcan0", "--out", self.log],
                                             stderr=subprocess.PIPE, text=True)
        with open(self.rig.robot_file, encoding="utf-8") as file:
            before = file.read()
        status, out, err = ctl("velocity", "0.1", "0", "--enter", "--for", "5")
        self.assertEqual((status, out), (3, ""))
        self.assertIn("blocked by not_identified, identify the robot first: wheelwright ctl mode ident", err)
        self.assertEqual(ctl("param", "save"), (0, "save: nothing has changed since the robot file was read\n", ""))
        with open(self.rig.robot_file, encoding="utf-8") as file:
            self.assertEqual(file.read(), before)
        self.rig.send("IdentSettings", Duration=25)  # as long as K5 and K6 need
        status, out, err = ctl("mode", "ident", seconds=120)
        print(out)
        self.assertEqual((status, err), (0, ""), out)
        self.assertTrue(self.rig.at_rest())
        self.assertEqual((self.rig.status()["State"], self.rig.status()["ModelTrusted"]), ("idle", 1))
        self.assertIn("left and right are not confirmed", out)
        self.record.send_signal(signal.SIGINT)
        self.assertEqual((self.record.wait(rig.LONG), self.record.stderr.read()[-1:]), (0, "\n"))
        self.record.stderr.close()
        self.assertRegex(ctl("param", "save")[1], r"^save: 1\d values are in the robot file\n$")
        with open(self.rig.robot_file, encoding="utf-8") as file:
            after = file.read()
        comments = lambda whole: [re.sub(r"# was [^:]*: ", "# ", one) for one in re.findall(r"#.*", whole)]
        self.assertEqual([one for one in comments(after) if one in comments(before)], comments(before))
        for key, name in (("K7", "k7_per_kg_m"), ("K8", "k8_per_kg_m2")):
            ratio = tomllib.loads(after)["dynamics"][name] / self.truth()[key]
            print(f"{key} in the file: {100 * (ratio - 1):+.2f} % off the truth")
            self.assertLess(abs(ratio - 1), 0.02)
        self.assertNotIn("K7 and K8 are not given", run("check", self.rig.robot_file)[1])

    def truth(self):
        with open(rig.robots("simulated.toml"), "rb") as file:
            truth = tomllib.load(file)
        with open(self.rig.robot_file, "rb") as file:
            return as_seen_with(truth, tomllib.load(file))

    def test_6_drive(self):
        began = time.time()
        self.assertEqual(ctl("velocity", "0.2", "0", "--enter", "--for", "3"), (0, "", ""))
        rows = [row for row in self.rig.truth(began) if began + 2 < row[0] < began + 2.8]
        self.assertGreater(len(rows), 20)
        for row in rows:
            self.assertLess(abs(row[4] - 0.2), 0.01)
        # It has waited for idle: what may begin at rest only may be asked for next.
        self.rig.attend()
        self.assertEqual(ctl("--no-wait", "mode", "ident"), (0, "", ""))
        self.rig.until_state("ident")
        self.assertEqual(ctl("mode", "idle"), (0, "state idle\n", ""))
        self.assertEqual(self.rig.missed_cycles(), 0)
        self.assertEqual(self.rig.stop_daemon(), 0)

    def test_7_the_log_tells_the_same(self):
        path = self.rig.file("ident.json")
        status, out, err = run("ident", self.log, "--model", self.rig.robot_file, "--json", path, seconds=60)
        self.assertEqual((status, err), (0, ""))
        with open(path, encoding="utf-8") as file:
            rows = {row["parameter"]: row for row in json.load(file)["dynamics"]["parameters"]}
        for key, truth in self.truth().items():
            value, deviation = rows[key]["value"], rows[key]["standard_error"]
            print(f"{key} from the log: {value} +- {deviation}, truth {truth:.5f}")
            self.assertLess(abs(value - truth), 4 * deviation + 0.002 * truth)
        status, out, err = run("monitor", "--log", self.log, seconds=60)
        self.assertEqual((status, err), (0, ""))
        self.assertIn("good_enough: K5 to K8 are known well enough", out)


if __name__ == "__main__":
    rig.main()
