"""The robot files that are shipped, from the file to the saved model, by the README's own commands: each against the
robot that it only roughly describes. Edited is what the file's own comments ask its reader to edit."""
import json
import os
import re
import signal
import subprocess
import tempfile
import time
import tomllib
import unittest

import rig
from drive import as_seen_with


def run(*arguments, seconds=rig.LONG):
    done = subprocess.run([rig.wheelwright(), *arguments], capture_output=True, text=True, timeout=seconds, check=False)
    return done.returncode, done.stdout, done.stderr


class Shipped(unittest.TestCase):
    def identify(self, name, plant, edit, duration_s):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        robot_file = os.path.join(folder.name, "robot.toml")
        with open(rig.robots(name), encoding="utf-8") as file:
            text = file.read()
        # The bus is spared the longest of the driving; for as long as the files ask for: the virtual time below.
        edited = re.sub(r"(?m)^\[ident\].*$", rf"\g<0>\nduration_s = {duration_s}", edit(text))
        self.assertNotEqual(edited, edit(text))
        self.assertNotEqual(edit(text), text)
        with open(robot_file, "w", encoding="utf-8") as file:
            file.write(edited)
        self.assertEqual(run("check", robot_file)[::2], (0, ""))
        soft = [] if rig.may_be_realtime() else ["--allow-soft-realtime"]
        for priority, command in (
                (40, [rig.wheelwright(), "sim", "--can", "vcan0", "--plant", rig.robots(plant)]),
                (80, [rig.wheelwrightd(), "--config", robot_file, "--can", "vcan0", *soft])):
            process = subprocess.Popen([*rig.realtime(priority), *command], stdout=subprocess.DEVNULL)
            self.addCleanup(process.wait, rig.LONG)
            self.addCleanup(process.send_signal, signal.SIGTERM)
        rig.until(lambda: run("monitor", "--can", "vcan0", "--for", "0.2")[0] == 0, "the firmware is heard")

        began = time.time()
        status, out, err = run("ctl", "--can", "vcan0", "mode", "ident", seconds=120)
        print(f"{name}, {time.time() - began:.0f} s:\n{out}")
        self.assertEqual((status, err), (0, ""), out)
        self.assertRegex(out, r"(?m)^state ident\n")
        self.assertRegex(out, r"(?m)^identified after \d+ s: ")
        status, out, err = run("ctl", "--can", "vcan0", "param", "save")
        self.assertEqual((status, err), (0, ""), out)
        self.assertRegex(out, r"^save: \d+ values are in the robot file\n$")
        with open(robot_file, "rb") as file:
            saved = tomllib.load(file)
        with open(rig.robots(plant), "rb") as file:
            truth = as_seen_with(tomllib.load(file), saved)
        for key, name_there in (("K7", "k7_per_kg_m"), ("K8", "k8_per_kg_m2")):
            ratio = saved["dynamics"][name_there] / truth[key]
            print(f"{key} in the file: {100 * (ratio - 1):+.2f} % off the truth")
            self.assertLess(abs(ratio - 1), 0.02)

    def test_template(self):
        self.identify("template.toml", "simulated.toml",
                      lambda text: text.replace("#watchdog_assured = true", "watchdog_assured = true"), 40)

    # Its numbers by [mass] are "a first guess": the [dynamics] that identification finds takes its place.
    def test_light(self):
        self.identify("light.toml", "simulated_light.toml",
                      lambda text: text.replace("[drive]\n", "[drive]\nwatchdog_assured = true\n"), 25)

    # (default.toml goes this way in workbench.py.)
    def test_all_in_virtual_time(self):
        for name, plant in (("template", "simulated"), ("light", "simulated_light"), ("heavy", "simulated_heavy")):
            with self.subTest(name), tempfile.TemporaryDirectory() as folder:
                robot_file, figures = os.path.join(folder, "robot.toml"), os.path.join(folder, "figures.json")
                rig.write_robot_file(robot_file, f"{name}.toml", {"drive.watchdog_assured": True})
                status, out, err = run("sim", "--robot", robot_file, "--plant", rig.robots(f"{plant}.toml"), "--json",
                                       figures, "ident", seconds=60)
                self.assertEqual((status, err), (0, ""), out)
                with open(figures, encoding="utf-8") as file:
                    found = next(section for key, section in json.load(file).items() if key.startswith("ident"))
                print(f"{name}.toml in virtual time: {found['duration_s']:.0f} s")
                for row in found["parameters"][2:4]:  # K7, K8; the frictions follow
                    print(f"{row['name']}: {100 * (row['value'] / row['true_value'] - 1):+.2f} % off the truth")
                    self.assertLess(abs(row["value"] / row["true_value"] - 1), 0.02)


if __name__ == "__main__":
    rig.main()
