"""Commands as frames: what is obeyed, what is refused and how it is counted, parameters, a host's bus of its own."""
import math
import os
import re
import signal
import struct
import subprocess
import time
import tomllib
import unittest

import rig
from rig import crc8, number_of

CAUSES = ["RejectedLength", "RejectedCrc", "RejectedAlive", "RejectedNotFinite", "RejectedRange",
          "RejectedUnknownMode", "RejectedModeNotAllowed", "RejectedUnpaired", "UnknownParameter", "RejectedAnswer"]


def counters(robot, since):
    """Every counter as it was reported after `since`, once all have been."""
    def all_reported():
        found = {}
        for _, data in robot.host.of("Counters", since):
            found.update(rig.DBC.decode(number_of("Counters"), data))
        return found if all(cause in found for cause in CAUSES) else None
    return robot.until(all_reported, "a round of counters")


class Commands(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.rig = rig.Rig()
        cls.addClassCleanup(cls.rig.end)
        cls.rig.start_robot()
        cls.rig.start_daemon()

    def setUp(self):
        self.rig.recover()

    def tearDown(self):
        self.assertEqual(self.rig.missed_cycles(), 0)

    def test_a_mode_is_switched_by_a_plain_cansend_line(self):
        # By hand from the text of the DBC: byte 0 Crc over the bytes after it, byte 1 Alive in the low nibble,
        # byte 2 Mode (2 torque, 4 velocity, 1 idle).
        self.assertEqual(crc8(b"123456789"), 0x4B)  # the algorithm's published check value
        self.assertEqual(crc8(bytes.fromhex("F20183")), 0x37)
        for alive, mode, state in ((5, 2, "torque"), (6, 4, "velocity"), (7, 1, "idle")):
            data = bytes([crc8(bytes([alive, mode])), alive, mode])
            subprocess.run(["cansend", "vcan0", f"601#{data.hex().upper()}"], check=True)
            self.rig.until_state(state)
        # The same line again works once its counter has been forgotten, after 500 ms.
        again = bytes([crc8(bytes([5, 2])), 5, 2])
        sent = self.rig.host.of("ModeCommand")[0][0]
        self.rig.until(lambda: time.time() > sent + 0.55, "half a second later")
        subprocess.run(["cansend", "vcan0", f"601#{again.hex().upper()}"], check=True)
        self.rig.until_state("torque")
        self.rig.mode("idle")

    def test_the_line_that_ctl_prints_is_taken(self):
        line = subprocess.run([rig.wheelwright(), "ctl", "--print", "--can", "vcan0", "--alive", "3", "mode", "torque"],
                              capture_output=True, text=True, check=True).stdout.split()
        self.assertEqual(line[:2], ["cansend", "vcan0"])
        self.assertEqual(line[2], f"601#{bytes([crc8(bytes([3, 2])), 3, 2]).hex().upper()}")
        sent = [when for when, _ in self.rig.host.of("ModeCommand")][-1:] or [0]
        self.rig.until(lambda: time.time() > sent[0] + 0.55, "half a second later")
        subprocess.run(line, check=True)
        self.rig.until_state("torque")
        self.rig.mode("idle")

    def test_ctl_asks_again_when_silent_drives_are_heard(self):
        # As when the firmware, or the robot's power, has come up just before.
        self.rig.robot.send_signal(signal.SIGSTOP)
        self.rig.until_status(lambda s: "silent" in (s["DriveLeft"], s["DriveRight"]), "a drive is silent")
        with subprocess.Popen([rig.wheelwright(), "ctl", "--can", "vcan0", "mode", "torque", "--for", "0.1"],
                              stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True) as ctl:
            self.rig.until_status(lambda s: s["Blocker"] == "drives_not_armed", "it is refused")
            self.rig.robot.send_signal(signal.SIGCONT)
            out = ctl.communicate(timeout=rig.LONG)[0]
        self.assertEqual(ctl.returncode, 0, out)
        self.assertRegex(out, "^state torque")

    def test_ctl_asks_again_when_its_request_was_not_heard(self):
        # As when another host has asked for something just before, with the counter that ctl begins with.
        for alive in range(5):
            self.rig.mode("idle")
            self.rig.until(lambda: time.time() > self.rig.host.of("ModeCommand")[-1][0] + 0.55, "half a second later")
            before = counters(self.rig, time.time())["RejectedAlive"]
            subprocess.run(["cansend", "vcan0", f"601#{rig.DBC.sealed('ModeCommand', alive, Mode='idle').hex()}"], check=True)
            ctl = subprocess.run([rig.wheelwright(), "ctl", "--can", "vcan0", "--alive", str(alive), "mode", "torque",
                                  "--for", "0.1"],
                                 capture_output=True, text=True, check=False)
            self.assertEqual(ctl.returncode, 0, ctl.stderr)
            if counters(self.rig, time.time())["RejectedAlive"] > before:
                return
        self.fail("ctl never came within half a second")

    def test_the_firmware_holds_little_memory(self):
        self.assertLess(self.rig.memory_MB(), 9)  # three stacks of 512 kB would be seen; 8 MB are wanted

    def test_bad_frames_are_refused_counted_by_cause_and_change_nothing(self):
        there = self.rig.popen([rig.wheelwright(), "ctl", "--can", "vcan0", "alive"], "alive.txt")
        self.rig.mode("torque")  # so that a wrong mode, torque or stop would show
        began = time.time()
        before = counters(self.rig, began)
        sealed = rig.DBC.sealed

        def bad(name, data, times=1):
            for _ in range(times):
                self.rig.host.cansend(number_of(name), data)

        def resealed(data):
            data = bytearray(data)
            data[0] = crc8(data[1:])
            return data

        mode = lambda alive, value: resealed(bytes([0, alive, value]))
        # 6 of a wrong length: too short, too long, empty; with a CRC that fits.
        bad("ModeCommand", resealed(bytes([0, 1])))
        bad("ModeCommand", resealed(bytes([0, 1, 1, 0])))
        bad("ModeCommand", "")
        bad("TorqueCommand", resealed(bytes(8)), 2)
        bad("VelocityCommand", resealed(bytes(5)))
        # 5 with a wrong CRC: a bit turned in the CRC, the counter, the value; a reflected or unfinished CRC.
        good = mode(1, 1)
        for byte, bit in ((0, 1), (1, 2), (2, 4)):
            data = bytearray(good)
            data[byte] ^= bit
            bad("ModeCommand", data)
        bad("TorqueCommand", bytes([0]) + sealed("TorqueCommand", 1, LeftTorque=3, RightTorque=3)[1:])
        bad("ClearFault", bytes([crc8(bytes([2])) ^ 0xFF, 2]))
        # 3 with a counter that is never valid.
        bad("ModeCommand", mode(15, 1), 2)
        bad("TorqueCommand", resealed(bytes([0, 15, 0, 16, 0, 16])))
        # 4 that are not numbers.
        for alive, value in enumerate((math.nan, math.inf, -math.inf, math.nan)):
            bad("ParameterRequest", resealed(bytes([0, alive | 1 << 4, 0x10, 0]) + struct.pack("<f", value)))
        # 7 out of range, or with a value that a table does not name.
        bad("TorqueCommand", resealed(bytes([0, 3]) + struct.pack("<hh", -32768, 0)))
        bad("TorqueCommand", resealed(bytes([0, 4]) + struct.pack("<hh", 0, -32768)))
        bad("VelocityCommand", resealed(bytes([0, 3]) + struct.pack("<hh", -32768, 0)))
        bad("PoseGoal", resealed(bytes([0, 3, 0, 0, 0, 0, 0, 3 << 6])))                           # direction 3
        bad("PoseGoal", resealed(bytes([0, 4, 0, 0, 0, 0]) + struct.pack("<H", 8000)))            # heading 3.2 rad
        bad("TrajectoryCommand", resealed(bytes([0, 3 | 5 << 4]) + bytes(6)))                     # shape 5
        bad("ParameterRequest", resealed(bytes([0, 9 | 5 << 4]) + bytes(6)))                      # operation 5
        # 4 modes that do not exist or cannot be asked for.
        for alive, value in ((3, 0), (4, 8), (5, 9), (6, 255)):
            bad("ModeCommand", mode(alive, value))
        # 2 modes that may not be entered now: ident only from idle, adaptive only with a trusted model.
        # Of two requests in one cycle only the later counts.
        bad("ModeCommand", mode(7, 3))
        self.rig.until(lambda: counters(self.rig, time.time())["RejectedModeNotAllowed"] >
                       before["RejectedModeNotAllowed"], "the first is counted")
        bad("ModeCommand", mode(8, 7))
        self.rig.until_status(lambda s: s["Blocker"] == "model_not_trusted", "the blocker is named")
        # 1 pose of a pair that never came, and 1 parameter that does not exist.
        bad("StreamedVelocity", sealed("StreamedVelocity", 4))
        bad("ParameterRequest", sealed("ParameterRequest", 10, Operation="read", Index=0x7FFF))
        # Nobody's: a remote frame, an extended identifier, a foreign one. Not ours to count.
        self.rig.host.cansend(number_of("ModeCommand"), "R")
        subprocess.run(["cansend", "vcan0", f"00000601#{mode(9, 1).hex()}"], check=True)
        self.rig.host.cansend(0x61F, bytes(8))

        after = counters(self.rig, time.time())
        counted = {cause: after[cause] - before[cause] for cause in CAUSES}
        print("refused:", {cause: int(count) for cause, count in counted.items()})
        self.assertEqual(counted, {"RejectedLength": 6, "RejectedCrc": 5, "RejectedAlive": 3, "RejectedNotFinite": 4,
                                   "RejectedRange": 7, "RejectedUnknownMode": 4, "RejectedModeNotAllowed": 2,
                                   "RejectedUnpaired": 1, "UnknownParameter": 1, "RejectedAnswer": 0})
        states = {(s["State"], s["Requested"], s["Fault"]) for s in
                  (rig.DBC.decode(number_of("Status"), data) for _, data in self.rig.host.of("Status", began))}
        self.assertEqual(states, {("torque", "torque", "none")})
        wheels = [rig.DBC.decode(number_of("WheelState"), data) for _, data in self.rig.host.of("WheelState", began)]
        self.assertEqual({(w["LeftTorque"], w["RightTorque"]) for w in wheels}, {(0.0, 0.0)})
        self.assertTrue(self.rig.at_rest())
        self.rig.mode("idle")
        there.send_signal(signal.SIGINT)
        self.assertEqual(there.wait(rig.LONG), 0)

    def test_a_repeated_counter_is_refused_while_it_is_remembered(self):
        data = lambda alive: rig.DBC.sealed("ModeCommand", alive, Mode="idle").hex().upper()
        for attempt in range(5):
            alive = 11 + attempt % 3
            before = counters(self.rig, time.time())["RejectedAlive"]
            sent = time.time()
            # One process, so that the second comes soon even where starting a program takes long.
            with open(os.path.join(self.rig.folder, "twice.log"), "w", encoding="ascii") as file:
                file.write(f"(0.000000) vcan0 601#{data(alive)}\n(0.020000) vcan0 601#{data(alive)}\n")
            subprocess.run(["canplayer", "-I", file.name], check=True)
            seen = self.rig.until(lambda: (lambda found: found if len(found) >= 2 else None)(
                self.rig.host.of("ModeCommand", sent)), "both on the bus")
            counted = counters(self.rig, time.time())["RejectedAlive"] - before
            if seen[1][0] - seen[0][0] < 0.4:
                self.assertEqual(counted, 1)
                return
        self.fail("the two frames never came soon after each other")

    def test_set_points_by_frames_turn_the_wheels_as_asked(self):
        # 0.4 Nm beats the Coulomb friction of 0.31 and 0.28 Nm, and viscous friction keeps the speed low.
        stream = self.rig.stream("TorqueCommand", 0.02, LeftTorque=-0.4, RightTorque=0.4)
        self.rig.mode("torque")
        self.rig.until(lambda: self.rig.truth()[5] > 0.2, "the robot turns left")
        latest = self.rig.until(lambda: self.rig.host.latest("WheelState"), "wheel state")
        self.assertEqual((latest["LeftTorque"], latest["RightTorque"]), (-0.4, 0.4))
        self.rig.watch_torques()
        torques = self.rig.until(lambda: (lambda found: all(found.values()) and found)(self.rig.torques(0)), "torques")
        self.assertAlmostEqual(torques["left"][-1][1], -0.4, places=6)
        self.assertAlmostEqual(torques["right"][-1][1], 0.4, places=6)
        self.rig.mode("idle")  # ramps; the set-points may go on
        self.rig.until(self.rig.at_rest, "the robot stands")
        self.rig.end_stream(stream)

    def request(self, operation, index=0, value=0.0):
        """Sends a ParameterRequest and returns the reply: (result, value)."""
        sent = time.time()
        self.rig.send("ParameterRequest", Operation=operation, Index=index, Value=value)
        def reply():
            for _, data in self.rig.host.of("ParameterReply", sent):
                answer = rig.DBC.decode(number_of("ParameterReply"), data)
                if answer["Operation"] == operation and (operation not in ("read", "write")
                                                         or answer["Index"] == index):
                    return answer["Result"], answer["Value"]
            return None
        return self.rig.until(reply, f"a reply to {operation}")

    def test_parameters_are_staged_committed_and_saved_with_the_comments_kept(self):
        torque_limit, track = 0x0010, 0x0003  # of docs/robot-file.md
        with open(self.rig.robot_file, encoding="utf-8") as file:
            text = file.read()
        self.assertEqual(self.request("read", torque_limit), ("ok", 5.0))
        self.assertEqual(self.request("commit"), ("nothing_staged", 0.0))
        self.assertEqual(self.request("write", torque_limit, 1.75), ("ok", 1.75))
        self.assertEqual(self.request("read", torque_limit), ("ok", 5.0))  # staged is not valid
        self.assertEqual(self.request("write", torque_limit, 1e9)[0], "out_of_range")
        self.assertEqual(self.request("write", track, 0.4)[0], "read_only")
        self.assertEqual(self.request("read", 0x7FFF)[0], "unknown_index")
        self.assertEqual(self.request("discard")[0], "ok")
        self.assertEqual(self.request("commit"), ("nothing_staged", 0.0))
        # Not while driving: it may change in idle only.
        self.assertEqual(self.request("write", torque_limit, 1.75), ("ok", 1.75))
        self.rig.mode("torque")
        self.assertEqual(self.request("commit")[0], "not_now")
        self.rig.mode("idle")
        self.assertEqual(self.request("commit")[0], "ok")
        self.assertEqual(self.request("read", torque_limit), ("ok", 1.75))
        with open(self.rig.robot_file, encoding="utf-8") as file:
            self.assertEqual(file.read(), text)  # nothing written unasked
        sent = time.time()
        self.assertEqual(self.request("save")[0], "save_started")
        def saved_values():
            replies = [rig.DBC.decode(number_of("ParameterReply"), data) for _, data in
                       self.rig.host.of("ParameterReply", sent)]
            return [reply["Value"] for reply in replies if reply["Result"] == "ok"]
        self.assertEqual(self.rig.until(saved_values, "saved"), [1.0])
        with open(self.rig.robot_file, encoding="utf-8") as file:
            saved = file.read()
        self.assertEqual(tomllib.loads(saved)["limits"]["torque_Nm"], 1.75)
        self.assertEqual(re.findall(r"#.*", saved), re.findall(r"#.*", text.replace("# at the wheel", "# was 5.0: at the wheel")))
        changed = [(a, b) for a, b in zip(text.splitlines(), saved.splitlines()) if a != b]
        self.assertEqual(len(changed), 1, changed)
        self.assertEqual(len(saved.splitlines()), len(text.splitlines()))
        self.assertEqual([name for name in os.listdir(self.rig.folder) if name.startswith("robot.toml")],
                         ["robot.toml"])


class HostBus(unittest.TestCase):
    def test_a_host_on_its_own_bus_drives_the_robot(self):
        robot = rig.Rig("vcan0", "vcan1", ["0:0"])
        self.addCleanup(robot.end)
        robot.start_robot()
        robot.start_daemon("--host-can", "vcan1")
        began = time.time()
        # Of commands on the drives' bus only a stop counts.
        robot.drives.cansend(number_of("EmergencyStop"), b"")
        robot.until_status(lambda s: s["Fault"] == "emergency_stop_message", "the stop is obeyed")
        robot.clear_fault()
        stream = robot.stream("VelocityCommand", 0.02, ForwardSpeed=0.2)
        robot.mode("velocity")
        robot.until(lambda: robot.truth()[4] > 0.15, "the robot drives")
        self.assertEqual(robot.status()["Fault"], "none")
        robot.end_stream(stream)
        robot.until_fault("stale_command")
        robot.drives.poll(), robot.host.poll()
        # No telemetry beside the drives, no drives beside the telemetry.
        ours = [number for number in robot.drives.frames if 0x620 <= number < 0x640]
        theirs = [number for number in robot.host.frames if number < 0x600]
        self.assertEqual((ours, theirs), ([], []))
        self.assertTrue(robot.host.of("Status", began))
        self.assertEqual(robot.stop_daemon(), 0)


class Key(unittest.TestCase):
    def test_a_robot_with_a_key_is_armed_by_who_holds_it_and_by_no_recording(self):
        robot = rig.Rig(filters=[*rig.USUAL, f"{number_of('ArmingChallenge'):03X}:7FF"])
        self.addCleanup(robot.end)
        ours, other = robot.file("robot.key"), robot.file("other.key")
        for path in (ours, other):
            subprocess.run([rig.wheelwright(), "key", "generate", path, "--robot", "cart"], check=True, capture_output=True)
        robot.start_robot()
        robot.start_daemon("--key", ours)

        def ctl(*words):
            done = subprocess.run([rig.wheelwright(), "ctl", "--can", "vcan0", *words], capture_output=True, text=True,
                                  timeout=120, check=False)
            return done.returncode, done.stdout + done.stderr

        robot.send("ModeCommand", Mode="torque")
        robot.until_status(lambda s: s["Blocker"] == "not_authenticated", "the refusal is named")
        robot.until(lambda: robot.host.of("ArmingChallenge"), "a challenge")
        status, said = ctl("mode", "torque")
        self.assertEqual(status, 3)
        self.assertIn("not_authenticated, the robot is armed with its key only: wheelwright ctl --key FILE", said)
        status, said = ctl("--key", other, "mode", "torque")
        self.assertEqual(status, 3)
        self.assertIn("the answer was refused: is this key the robot's?", said)
        self.assertEqual({s["State"] for s in (rig.DBC.decode(number_of("Status"), data)
                                               for _, data in robot.host.of("Status"))} - {"boot"}, {"idle"})
        self.assertEqual(ctl("--key", ours, "mode", "torque", "--for", "0.1"), (0, "state torque\n"))
        recorded = bytearray(robot.host.of("ArmingAnswer")[-1][1])

        # What armed it, once more, sealed anew, where a new challenge waits for its answer.
        asked = time.time()
        robot.send("ModeCommand", Mode="torque")
        robot.until(lambda: robot.host.of("ArmingChallenge", asked), "another challenge")
        before = counters(robot, asked)["RejectedAnswer"]
        recorded[1] = recorded[1] & 0xF0 | ((recorded[1] & 15) + 1) % 15
        recorded[0] = crc8(recorded[1:])
        robot.host.cansend(number_of("ArmingAnswer"), recorded)
        robot.until(lambda: counters(robot, time.time())["RejectedAnswer"] > before, "the recording is refused")
        self.assertEqual((robot.status()["State"], robot.status()["DriveLeft"]), ("idle", "idle"))

        # Set-points with --enter; a stop by one frame.
        driving = robot.popen([rig.wheelwright(), "ctl", "--can", "vcan0", "--key", ours, "velocity", "0.2", "0", "--enter"],
                              "ctl.txt")
        robot.until(lambda: robot.truth()[4] > 0.15, "the robot drives")
        robot.send("EmergencyStop")
        robot.until_fault("emergency_stop_message")
        self.assertEqual(driving.wait(rig.LONG), 3)
        robot.clear_fault()
        self.assertEqual(robot.stop_daemon(), 0)
        with open(ours, encoding="ascii") as file:
            secret = re.search(r"^key (\w{32})$", file.read(), re.M)[1]
        said = robot.said(robot.daemon)
        self.assertIn("wheelwrightd: arming needs the key of cart (", said)
        self.assertNotIn(secret, said)

        os.chmod(ours, 0o640)
        done = subprocess.run([rig.wheelwrightd(), "--config", robot.robot_file, "--can", "vcan0", "--key", ours],
                              capture_output=True, text=True, timeout=30, check=False)
        self.assertEqual((done.returncode, done.stderr), (1, f"wheelwrightd: {ours}: others may use this key: found mode "
                                                             "0640, expected 0600 (chmod 600)\n"))


if __name__ == "__main__":
    rig.main()
