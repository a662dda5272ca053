"""`wheelwright demo --can`: the main job of the front door in real time on vcan0, with the robot files as they are. It has
to reach its aims there as in virtual time; they are the demo's own, and its exit status says so."""
import json
import os
import subprocess
import tempfile
import unittest

import rig


class Demo(unittest.TestCase):
    def test_the_main_job_in_real_time(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        figures = os.path.join(folder.name, "figures.json")
        done = subprocess.run([rig.wheelwright(), "demo", "--can", "vcan0", "--robot", rig.robots("default.toml"),
                               "--plant", rig.robots("simulated.toml"), "--out", folder.name, "--json", figures],
                              capture_output=True, text=True, timeout=200, check=False)
        print(done.stdout)
        self.assertEqual(done.returncode, 0, done.stderr)
        if rig.may_be_realtime():
            self.assertEqual(done.stderr, "")
        self.assertNotIn("stopped", done.stdout)
        with open(figures, encoding="utf-8") as file:
            found = json.load(file)
        for row in found["identification"]["parameters"]:
            if row["name"].startswith(("K7", "K8")):
                self.assertLess(abs(row["error_percent"]), 2)
        # Said once more, so that nobody has to believe the demo's own judgment.
        drive = found["driving"]
        for key in ("settling_speed_ms", "settling_yaw_ms"):
            self.assertTrue(0 < drive[key] <= 50, drive)
        self.assertLess(drive["figure_eight_rms_mm"], 5)
        self.assertLess(drive["figure_eight_peak_mm"], 15)
        self.assertLess(drive["adaptive_rms_mm"], 5)
        for key in ("payload_k7_error_percent", "payload_k8_error_percent"):
            self.assertLess(abs(drive[key]), 5)
        self.assertEqual(found["real_time"]["missed_cycles"], 0)
        self.assertGreater(os.path.getsize(os.path.join(folder.name, "index.html")), 100_000)

    def test_an_interface_that_does_not_exist(self):
        done = subprocess.run([rig.wheelwright(), "demo", "--can", "can9"], capture_output=True, text=True, timeout=30,
                              check=False)
        self.assertEqual(done.returncode, 4)
        self.assertIn("There is no interface can9", done.stderr.splitlines()[-1])


if __name__ == "__main__":
    rig.main()
