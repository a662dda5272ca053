"""ctl, monitor and record on a real vcan0, against a pretended firmware that knows only canmatrix and the
kernel. Run by toolchain/uml/with-vcan where there is no vcan0. Usage: on_vcan.py PROGRAM SOURCE_FOLDER"""
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import canmatrix.formats

PROGRAM, SOURCE = sys.argv[1], sys.argv[2]
DBC = list(canmatrix.formats.loadp(os.path.join(SOURCE, "firmware/protocol/wheelwright.dbc")).values())[0]
IDS = {frame.name: frame.arbitration_id.id for frame in DBC.frames}
NAMES = {number: name for name, number in IDS.items()}
MODES = ["boot", "idle", "torque", "ident", "velocity", "pose", "trajectory", "adaptive", "fault"]


def encode(name, **values):
    frame = DBC.frame_by_name(name)
    raw = {signal.name: 0 for signal in frame.signals}
    raw.update(values)
    return frame.encode(raw)


class Firmware(threading.Thread):
    """Sends Status each 20 ms, enters each mode it is asked for (but refuses adaptive), answers parameters.
    `ending`: how the ident mode goes, see identify()."""

    def __init__(self):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.bind(("vcan0",))
        self.socket.settimeout(0.005)
        self.received = []  # (time, name, data)
        self.state, self.blocker = 1, 0
        self.value = 5.0
        self.saved = 12  # values that a save writes
        self.refusal = 0  # a blocker: modes are not entered
        self.braking_s = 0  # from the request for idle until idle
        self.at_rest = None  # time of that, while it brakes
        self.ending = None
        self.also = []  # (message, raw values) sent beside Status
        self.drives = 0  # state of both drives
        self.running = True
        self.start()

    def identify(self, cause, lasts_s=1.0, rolls_s=0.0, **flags):
        """The next ident mode ends so, and the robot stands `rolls_s` later."""
        self.ending = {"cause": cause, "lasts": lasts_s, "rolls": rolls_s, "flags": flags, "ends": None}

    def step_ident(self, now):
        if self.ending is None:
            return
        ends, done = self.ending["ends"], self.ending["cause"] in ("good_enough", "direction_unverified", "coupling_not_known")
        over = ends is not None and now >= ends
        if over and self.state == 3:
            self.state = 1
            if self.ending["flags"].get("TorqueClipped"):
                self.value = 3.2
        phases, causes = DBC.value_tables["IdentPhase"], DBC.value_tables["IdentCause"]
        number = lambda table, name: next(int(key) for key, text in table.items() if text == name)
        phase, cause = ("done" if done else "stopped_by_limit", self.ending["cause"]) if over else ("estimating", "none")
        self.send("IdentStatus", encode("IdentStatus", Phase=number(phases, phase), Cause=number(causes, cause), Delay=1430,
                                        **(self.ending["flags"] if over else {})))
        rolling = ends is not None and now < ends + self.ending["rolls"]
        self.send("BodyState", encode("BodyState", ForwardSpeed=400 if rolling else 1))
        for name, one, other in (("EstimateK5K7", ("K5", 0.04), ("K7", 1.25)), ("EstimateK6K8", ("K6", -1.5), ("K8", 6.9)),
                                 ("StandardErrorK5K7", ("K5", 0.002), ("K7", 0.003)),
                                 ("StandardErrorK6K8", ("K6", 0.1), ("K8", 0.02))):
            self.send(name, encode(name, **dict((one, other))))

    def send(self, name, data):
        self.socket.send(struct.pack("=IB3x8s", IDS[name], len(data), bytes(data)))

    def run(self):
        due = 0
        while self.running:
            now = time.monotonic()
            if self.at_rest is not None and now >= self.at_rest:
                self.state, self.at_rest = 1, None
            if now >= due:
                due = now + 0.02
                requested = self.state if self.at_rest is None else 1
                self.send("Status", encode("Status", State=self.state, Requested=requested, Blocker=self.blocker,
                                           DriveLeft=self.drives, DriveRight=self.drives))
                for name, values in list(self.also):
                    self.send(name, encode(name, **values))
                self.step_ident(now)
            try:
                number, length, data = struct.unpack("=IB3x8s", self.socket.recv(16))
            except TimeoutError:
                continue
            name, data = NAMES.get(number), data[:length]
            self.received.append((time.monotonic(), name, data))
            if name == "ModeCommand":
                blocker = 6 if data[2] == 7 else self.refusal
                if self.ending is not None and not blocker:
                    if data[2] == 3:
                        self.ending["ends"] = now + self.ending["lasts"]
                    elif self.state == 3:
                        self.ending |= {"cause": "interrupted", "ends": now}
                if data[2] == 1 and self.braking_s > 0:
                    self.at_rest = time.monotonic() + self.braking_s
                else:
                    self.state, self.blocker = (self.state if blocker else data[2], blocker)
            elif name == "EmergencyStop":
                self.state = 8
            elif name == "ClearFault":
                self.state = 1
            elif name == "ParameterRequest":
                operation, index = data[1] >> 4, data[2] | data[3] << 8
                result = 0
                if operation == 1:
                    self.value = struct.unpack("<f", data[4:8])[0]
                elif operation == 2:
                    result = 5
                elif operation == 4:
                    self.send("ParameterReply", bytes([4 | 8 << 4, 0, 0, 0]) + bytes(4))
                    time.sleep(0.05)
                self.send("ParameterReply", bytes([operation | result << 4, index & 255, index >> 8, 0])
                          + struct.pack("<f", self.saved if operation == 4 else self.value))

    def end(self):
        self.running = False
        self.join()
        self.socket.close()

    def of(self, name, at_least=0):
        """All of this message so far; waits until there are so many, as this thread may lag."""
        deadline = time.monotonic() + 5
        while sum(received == name for _, received, _ in self.received) < at_least and time.monotonic() < deadline:
            time.sleep(0.01)
        return [(when, data) for when, received, data in self.received if received == name]


def run(*arguments):
    done = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, timeout=30)
    return done.returncode, done.stdout, done.stderr


class OnVcan(unittest.TestCase):
    def setUp(self):
        self.firmware = Firmware()
        self.addCleanup(self.firmware.end)

    def test_modes_are_entered_or_the_refusal_is_named(self):
        self.assertEqual(run("ctl", "--can", "vcan0", "mode", "velocity", "--for", "0.3"), (0, "state velocity\n", ""))
        status, _, err = run("ctl", "--can", "vcan0", "mode", "adaptive")
        self.assertEqual(status, 3)
        self.assertIn("blocked by model_not_trusted", err)
        status, out, _ = run("ctl", "--can", "vcan0", "stop")
        self.assertEqual((status, out), (0, "state fault, blocked by model_not_trusted\n"))
        self.assertEqual(run("ctl", "--can", "vcan0", "clear")[0], 0)

    def test_a_drives_error_is_named_where_a_mode_is_refused_and_where_it_survives_clearing(self):
        self.firmware.refusal, self.firmware.drives = 13, 4
        self.firmware.also = [("DriveError", {"Wheel": 0, "Generation": 5, "Error": 0}),
                              ("DriveError", {"Wheel": 1, "Generation": 5, "Error": 0x4000})]
        for call in (("mode", "velocity"), ("velocity", "0.1", "0", "--enter", "--for", "0.4")):
            status, _, err = run("ctl", "--can", "vcan0", *call)
            self.assertEqual(status, 3)
            self.assertIn("blocked by drive_error; the right drive reports estop_requested (0x4000); "
                          "remove the cause, then `wheelwright ctl clear`\n", err)
        status, _, err = run("ctl", "--can", "vcan0", "clear")
        self.assertEqual(status, 3)
        self.assertIn("a drive keeps its error: the right drive reports estop_requested (0x4000)\n", err)
        self.firmware.drives, self.firmware.also = 1, []
        self.assertEqual(run("ctl", "--can", "vcan0", "clear")[0], 0)

    def test_a_path_that_is_stretched_is_told_where_it_is_chosen(self):
        self.firmware.also = [("TrajectoryPace", {"Shape": 0, "AskedPeriod": 800, "Period": 1320, "LimitedBy": 5})]
        call = ("ctl", "--can", "vcan0", "trajectory", "figure_eight", "--period")
        self.assertEqual(run(*call, "8"), (0, "the period is 13.20 s in place of 8.00 s, so that limits.torque_Nm "
                                              "leaves room for feedback\n", ""))
        self.assertEqual(run(*call, "9"), (0, "", ""))  # nothing is known of this one

    def test_what_the_identification_found_and_chose_is_told_at_its_end(self):
        names = [s.name for s in DBC.frame_by_name("IdentSizing").signals if s.mux_val is not None and not s.is_multiplexer]
        self.firmware.also = [("IdentSizing", {"Quantity": i, name: 0.5}) for i, name in enumerate(names)]
        self.firmware.identify("good_enough")
        status, out, err = run("ctl", "--can", "vcan0", "mode", "ident")
        self.assertEqual((status, err), (0, ""))
        self.assertIn("chosen: 0.5 Nm in bits of 500 ms", out)
        self.assertIn("found: the wheels move at 0.5 Nm (left) and 0.5 Nm (right)", out)

    def test_calls_in_a_row_never_repeat_the_alive_counter(self):
        for _ in range(6):
            self.assertEqual(run("ctl", "--can", "vcan0", "--no-wait", "mode", "idle")[0], 0)
        frames = self.firmware.of("ModeCommand", 6)
        self.assertEqual(len(frames), 6)
        for (before, first), (after, second) in zip(frames, frames[1:]):
            if after - before < 0.5:
                self.assertNotEqual(first[1] & 15, second[1] & 15)

    def test_a_mode_asked_for_by_one_call_after_another_never_repeats_the_counter(self):
        for _ in range(3):  # idle at the end of one call, torque at the beginning of the next
            self.assertEqual(run("ctl", "--can", "vcan0", "torque", "0", "0", "--enter", "--for", "0.5")[0], 0)
        frames = self.firmware.of("ModeCommand", 6)
        self.assertEqual([data[2] for _, data in frames], [2, 1] * 3)
        for (before, first), (after, second) in zip(frames, frames[1:]):
            if after - before < 0.5:
                self.assertNotEqual(first[1] & 15, second[1] & 15)

    def test_the_robot_is_idle_when_a_call_with_enter_ends(self):
        self.firmware.braking_s = 0.7
        self.assertEqual(run("ctl", "--can", "vcan0", "velocity", "0.2", "0", "--enter", "--for", "0.3"), (0, "", ""))
        self.assertEqual(self.firmware.state, 1)
        self.firmware.braking_s = 1000
        status, _, err = run("ctl", "--can", "vcan0", "velocity", "0.2", "0", "--enter", "--for", "0.3")
        self.assertEqual(status, 3)
        self.assertIn("idle was asked for 10 s ago, and the robot is not idle yet", err)

    def test_setpoints_are_repeated_at_their_rate_with_running_counters(self):
        status, _, err = run("ctl", "--can", "vcan0", "velocity", "0.25", "-0.5", "--for", "1", "--enter")
        self.assertEqual((status, err), (0, ""))
        self.assertEqual([data[2] for _, data in self.firmware.of("ModeCommand", 2)], [4, 1])
        frames = self.firmware.of("VelocityCommand")
        self.assertTrue(25 <= len(frames) <= 52, len(frames))
        counters = [data[1] & 15 for _, data in frames]
        self.assertTrue(all(b == (a + 1) % 15 for a, b in zip(counters, counters[1:])), counters)
        self.assertEqual(struct.unpack("<hh", frames[0][1][2:6]), (500, -500))
        run("ctl", "--can", "vcan0", "torque", "1", "2", "--for", "0.5", "--rate", "100")
        self.assertTrue(25 <= len(self.firmware.of("TorqueCommand", 25)) <= 52)

    def test_an_advised_motion_is_driven_until_the_robot_leaves_it(self):
        with tempfile.NamedTemporaryFile("w", suffix=".json") as advice:
            json.dump({"advice": [{"tell": "a", "from": "b", "name": "creep", "torque_Nm": 2.0}]}, advice)
            advice.flush()
            arguments = ("excite", "--advice", advice.name, "--robot", os.path.join(SOURCE, "tools/robots/default.toml"),
                         "--can", "vcan0", "--json", advice.name + ".out")
            process = subprocess.Popen([PROGRAM, *arguments, "--yes"], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                       text=True)
            self.firmware.of("TorqueCommand", 40)
            self.firmware.state = 8
            _, err = process.communicate(timeout=30)
            with open(advice.name + ".out", encoding="utf-8") as file:
                size = json.load(file)["motion"]["torque_Nm"]
            os.unlink(advice.name + ".out")
            self.assertEqual(process.returncode, 3, err)
            self.assertIn("the robot has left torque: state fault", err)
            self.assertEqual(subprocess.run([PROGRAM, *arguments], input="n\n", text=True, capture_output=True).returncode, 3)
            os.unlink(advice.name + ".out")
        self.assertEqual([data[2] for _, data in self.firmware.of("ModeCommand", 2)], [2, 1])
        torques = [struct.unpack("<hh", data[2:6]) for _, data in self.firmware.of("TorqueCommand")]
        self.assertEqual(torques[0], (0, 0))
        self.assertEqual(set(torques[10:30]), {(round(size / 4 * 1000), round(size / 4 * 1000))})

    def test_what_gap_found_is_written_to_the_robot_once_the_operator_agrees(self):
        with tempfile.TemporaryDirectory() as folder:
            robots, log = os.path.join(SOURCE, "tools/robots"), os.path.join(folder, "x.log")
            plant = os.path.join(folder, "plant.toml")
            with open(os.path.join(robots, "simulated.toml"), encoding="utf-8") as file:
                text = file.read()
            with open(plant, "w", encoding="utf-8") as file:
                file.write(text + "\n[effects.turning_scrub]\nscrub_Nm = 0.3\n")
            model = os.path.join(robots, "default.toml")
            self.assertIn(run("sim", "--robot", model, "--plant", plant, "--log", log, "--duration", "25", "ident")[0], (0, 3))
            arguments = ["gap", log, "--model", model, "--out", folder, "--close-loop", "--can", "vcan0"]
            done = subprocess.run([PROGRAM, *arguments], input="n\n", capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 3, done.stderr)
            self.assertIn("nothing was written", done.stderr)
            self.assertEqual({data[1] >> 4 for _, data in self.firmware.of("ParameterRequest")}, {0})
            done = subprocess.run([PROGRAM, *arguments, "--yes"], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 3, done.stdout + done.stderr)  # this firmware refuses to commit
            self.assertIn("commit: not_now", done.stderr)
            requests = [data for _, data in self.firmware.of("ParameterRequest")]
            written = {data[2] | data[3] << 8: struct.unpack("<f", data[4:8])[0] for data in requests if data[1] >> 4 == 1}
            with open(os.path.join(folder, "gap.json"), encoding="utf-8") as file:
                found = json.load(file)
            self.assertEqual([effect["name"] for effect in found["effects"]], ["turning_scrub"])
            scrub = found["effects"][0]["parameters"][0]["value"]
            indices = {index for index, value in written.items() if index >= 0x4000 and abs(value - scrub) < 1e-6}
            self.assertEqual(len(indices), 1)
            self.assertEqual(written[indices.pop() | 15], 1)  # its flag `active`
            self.assertAlmostEqual(written[0x82], found["parameter_shift"]["k7_per_kg_m"]["value"], places=5)
            self.assertEqual([data[1] >> 4 for data in requests][-1], 3)  # discarded, as it was not committed

    def test_repetition_ends_when_the_mode_is_refused_or_left(self):
        arguments = ("ctl", "--can", "vcan0", "velocity", "0.25", "0", "--for", "20", "--enter")
        self.firmware.refusal = 2  # fault_latched
        status, out, err = run(*arguments)
        self.assertEqual((status, out), (3, ""))
        self.assertIn("the robot did not enter velocity: state idle, blocked by fault_latched", err)
        self.firmware.refusal = 0
        process = subprocess.Popen([PROGRAM, *arguments], stderr=subprocess.PIPE, text=True)
        self.firmware.of("VelocityCommand", 30)
        self.firmware.state = MODES.index("fault")
        self.assertEqual(process.wait(5), 3)
        self.assertIn("the robot has left velocity: state fault", process.stderr.read())
        process.stderr.close()

    def test_ctrl_c_ends_repetition(self):
        process = subprocess.Popen([PROGRAM, "ctl", "--can", "vcan0", "torque", "0", "0"])
        self.firmware.of("TorqueCommand", 3)
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(10), 0)

    def test_parameters_are_read_written_and_saved(self):
        self.assertEqual(run("ctl", "--can", "vcan0", "param", "set", "limits.torque_Nm", "4.3")[1],
                         "limits.torque_Nm = 4.3 Nm\n")
        self.assertEqual(run("ctl", "--can", "vcan0", "param", "get", "0x0010")[1], "limits.torque_Nm = 4.3 Nm\n")
        status, _, err = run("ctl", "--can", "vcan0", "param", "commit")
        self.assertEqual(status, 3)
        self.assertIn("not_now", err)
        self.assertEqual(run("ctl", "--can", "vcan0", "param", "save")[1], "save: 12 values are in the robot file\n")
        self.firmware.saved = 0
        self.assertEqual(run("ctl", "--can", "vcan0", "param", "save"),
                         (0, "save: nothing has changed since the robot file was read\n", ""))

    def test_ident_is_waited_for_until_the_robot_stands_and_says_what_it_found(self):
        self.firmware.identify("good_enough", rolls_s=0.7, TorqueClipped=1)
        status, out, err = run("ctl", "--can", "vcan0", "mode", "ident")
        self.assertGreater(time.monotonic(), self.firmware.ending["ends"] + 0.7)
        self.assertEqual((status, err), (0, ""))
        for line in (r"state ident", r"identified after [12] s: K5 to K8 are known well enough",
                     r"  K7  1\.25 ± 0\.003 1/\(kg m\)", r"  K5  0\.04 ± 0\.002 m", r"  delay  1\.43 ms",
                     r"the drives deliver 3\.2 Nm of the 5 Nm of limits\.torque_Nm; 3\.2 Nm is the limit now",
                     r"left and right are not confirmed: .*", r".*`wheelwright ctl param save` writes it.*"):
            self.assertRegex(out, f"(?m)^{line}$")

    def test_an_identification_without_coupling_says_what_is_not_kept(self):
        self.firmware.identify("coupling_not_known", SidesConfirmed=1)
        status, out, err = run("ctl", "--can", "vcan0", "mode", "ident")
        self.assertEqual((status, err), (0, ""))
        self.assertIn("K5  0.04 ± 0.002 m, not kept\n", out)
        self.assertIn("K5 and K6 are not yet and stay as they were: for these a longer ident.duration_s", out)
        self.assertNotIn("not confirmed", out)

    def test_an_identification_that_fails_says_why_and_what_to_change(self):
        self.firmware.identify("wheels_swapped")
        status, out, err = run("ctl", "--can", "vcan0", "mode", "ident")
        self.assertEqual((status, out), (3, "state ident\n"))
        self.assertIn("drive.left drives the right wheel: exchange drive.left.node and drive.right.node", err)
        self.assertIn("nothing is kept", err)
        self.firmware.identify("interrupted", lasts_s=20)
        process = subprocess.Popen([PROGRAM, "ctl", "--can", "vcan0", "mode", "ident"], stderr=subprocess.PIPE, text=True)
        self.firmware.of("ParameterRequest", 2)
        self.firmware.state = MODES.index("fault")
        self.firmware.ending["ends"] = 0
        _, err = process.communicate(timeout=10)
        self.assertEqual(process.returncode, 3)
        self.assertIn("the robot has left ident: state fault", err)

    def test_ctrl_c_ends_an_identification_with_idle(self):
        self.firmware.identify("good_enough", lasts_s=20)
        process = subprocess.Popen([PROGRAM, "ctl", "--can", "vcan0", "mode", "ident"], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True)
        self.firmware.of("ParameterRequest", 1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=10)
        self.assertEqual(process.returncode, 3)
        self.assertIn("Ctrl-C: the robot is asked for idle\n", out)
        self.assertIn("another mode came before the end", err)
        self.assertEqual([data[2] for _, data in self.firmware.of("ModeCommand", 2)], [3, 1])

    def test_ident_is_not_waited_for_by_scripts_that_say_so(self):
        self.firmware.identify("good_enough", lasts_s=20)
        began = time.monotonic()
        self.assertEqual(run("ctl", "--can", "vcan0", "--no-wait", "mode", "ident"), (0, "", ""))
        self.assertLess(time.monotonic(), began + 5)

    def test_a_robot_that_drives_is_watched_over_until_ctrl_c_or_the_time_is_over(self):
        for number, mode in ((5, "pose"), (6, "trajectory")):
            del self.firmware.received[:]
            call = [PROGRAM, "ctl", "--can", "vcan0", "mode", mode]
            process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True)
            said = self.firmware.of("HostAlive", 4)
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=10)
            self.assertEqual((process.returncode, out), (0, f"state {mode}\n"))
            self.assertTrue(all(0.05 < b[0] - a[0] < 0.35 for a, b in zip(said, said[1:])), said)
            self.assertEqual([data[2] for _, data in self.firmware.of("ModeCommand", 2)], [number, 1])
            self.assertEqual(run(*call[1:], "--for", "0.5")[0], 0)
            self.assertEqual([data[2] for _, data in self.firmware.of("ModeCommand", 4)][2:], [number, 1])
        self.assertEqual(run("ctl", "--can", "vcan0", "trajectory", "circle", "--enter", "--for", "0.5")[0], 0)
        self.assertEqual(run("ctl", "--can", "vcan0", "alive", "--for", "0.3")[0], 0)

    def test_monitor_prints_lines_when_it_is_not_on_a_terminal(self):
        status, out, err = run("monitor", "--can", "vcan0", "--for", "1", "--every", "0.3")
        self.assertEqual((status, err), (0, ""))
        self.assertTrue(2 <= len(out.splitlines()) <= 5, out)
        self.assertIn("idle", out)

    def test_a_record_is_what_candump_writes(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "bus.log")
            candump = subprocess.Popen(["candump", "-L", "vcan0"], stdout=subprocess.PIPE, text=True)
            record = subprocess.Popen([PROGRAM, "record", "--can", "vcan0", "--out", path],
                                      stderr=subprocess.PIPE, text=True)
            time.sleep(2)
            for frame in ("123#R", "00012345#1122", "7FF#0011223344556677", "100#"):
                subprocess.run(["cansend", "vcan0", frame], check=True)
            time.sleep(2)
            record.send_signal(signal.SIGINT)
            self.assertEqual(record.wait(5), 0)
            self.assertRegex(record.stderr.read(), r"^\d+ frames in \d\.\d s\n$")
            record.stderr.close()
            candump.terminate()
            theirs = candump.stdout.read().splitlines()
            candump.stdout.close()
            candump.wait()
            with open(path, encoding="ascii") as file:
                ours = file.read().splitlines()
            self.assertGreater(len(ours), 30)
            frames = [line.split(" ", 1)[1] for line in ours]
            for frame in ("123#R", "00012345#1122", "7FF#0011223344556677", "100#"):
                self.assertIn("vcan0 " + frame, frames)
            # The same frames with the kernel's times; our clock conversion may be off by a little.
            all_theirs = [line.split(" ", 1)[1] for line in theirs]
            self.assertIn("\n".join(frames), "\n".join(all_theirs))
            marker = "vcan0 00012345#1122"
            time_of = lambda lines: float(re.match(r"\((.*?)\)", next(x for x in lines if marker in x)).group(1))
            self.assertLess(abs(time_of(ours) - time_of(theirs)), 0.001)
            self.assertEqual(run("record", "--can", "vcan0", "--out", path)[0], 1)  # never overwritten
            self.assertEqual(run("monitor", "--log", path)[0], 0)


class Silence(unittest.TestCase):
    def test_nobody_answers(self):
        status, _, err = run("ctl", "--can", "vcan0", "mode", "idle")
        self.assertEqual(status, 3)
        self.assertIn("no Status frame came back", err)
        self.assertEqual(run("ctl", "--can", "vcan0", "param", "get", "limits.torque_Nm")[0], 3)
        self.assertEqual(run("monitor", "--can", "vcan0", "--for", "0.2")[0], 3)

    def test_an_interface_that_is_down_is_4(self):
        subprocess.run(["ip", "link", "add", "vcan9", "type", "vcan"], check=True)
        status, _, err = run("ctl", "--can", "vcan9", "mode", "idle")
        self.assertEqual(status, 4)
        self.assertEqual(err.count("\n"), 1)
        self.assertIn("up", err)
        subprocess.run(["ip", "link", "delete", "vcan9"], check=True)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v"])
