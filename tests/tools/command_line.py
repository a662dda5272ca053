"""The program wheelwright from outside: exit statuses, help texts, cansend lines decoded by canmatrix, robot
files, logs. Needs no CAN. Usage: command_line.py PROGRAM SOURCE_FOLDER [--write-page]

--write-page brings the reference in docs/robot-file.md up to date instead, after a change of the tables."""
import decimal
import glob
import json
import math
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import tomllib
import unittest

import canmatrix.formats

PROGRAM, SOURCE = sys.argv[1], sys.argv[2]
ROBOTS = os.path.join(SOURCE, "tools/robots")
DBC = list(canmatrix.formats.loadp(os.path.join(SOURCE, "firmware/protocol/wheelwright.dbc")).values())[0]


def run(*arguments, text=None):
    done = subprocess.run([PROGRAM, *map(str, arguments)], input=text, capture_output=True, text=True, timeout=20)
    return done.returncode, done.stdout, done.stderr


def crc8(data):
    """SAE J1850, bit by bit."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D) & 0xFF if crc & 0x80 else crc << 1
    return crc ^ 0xFF


def decode(line):
    """(interface, message name, {signal: physical value}) of a cansend line; checks the CRC."""
    match = re.fullmatch(r"cansend (\S+) ([0-9A-F]{3})#([0-9A-F]*)", line)
    assert match, line
    data = bytes.fromhex(match.group(3))
    frame = DBC.frame_by_id(canmatrix.ArbitrationId(int(match.group(2), 16), extended=False))
    assert len(data) == frame.size, line
    values = {name: signal.phys_value for name, signal in frame.decode(data).items()}
    if "Crc" in values:
        assert data[0] == crc8(data[1:]), line
    return match.group(1), frame.name, values


class Help(unittest.TestCase):
    def test_every_subcommand_explains_itself(self):
        status, out, _ = run("--help")
        self.assertEqual(status, 0)
        self.assertIn("Exit status: 0 done; 1 usage or configuration; 2 unusable input", out)
        commands = re.findall(r"^  ([\w-]+)  +\S", out.split("Subcommands:")[1], re.M)
        for name in ("check", "ctl", "gap", "gap-trials", "monitor", "record"):
            self.assertIn(name, commands)
        for name in commands:
            status, out, err = run(name, "--help")
            self.assertEqual((status, err), (0, ""), name)
            self.assertGreater(len(out), 100, name)

    def test_every_control_command_explains_itself(self):
        _, out, _ = run("ctl", "--help")
        for name in re.findall(r"^  ([\w-]+)  +\S", out.split("Subcommands:")[1], re.M):
            self.assertEqual(run("ctl", name, "--help")[0], 0, name)


class Status(unittest.TestCase):
    def test_wrong_usage_is_1(self):
        for arguments in ((), ("nonsense",), ("check",), ("check", "--nonsense"), ("ctl",), ("ctl", "mode"),
                          ("ctl", "velocity", "1"), ("ctl", "velocity", "1", "x"), ("ctl", "mode", "warp"),
                          ("ctl", "mode", "fault"), ("ctl", "goal", "0", "0", "0", "--direction", "up"),
                          ("torture", "--kind", "lie_sign,nonsense"), ("torture", "--kind", "stall,reorder", "--seed", "1", "--log", "a.log"),
                          ("ctl", "velocity", "50", "0", "--print"), ("ctl", "torque", "nan", "0", "--print"),
                          ("ctl", "param", "get", "geometry.nothing"), ("ctl", "--alive", "15", "stop", "--print"),
                          ("ctl", "param", "set", "geometry.track_m", "0.3"),
                          ("ctl", "param", "set", "limits.torque_Nm", "-1"),
                          ("record",), ("monitor", "--log", "x", "--can", "y")):
            status, _, err = run(*arguments)
            self.assertEqual(status, 1, arguments)
            self.assertNotEqual(err, "", arguments)

    def test_a_number_out_of_range_is_refused_in_plain_words(self):
        positive = [("sim", "--duration"), ("monitor", "--every"), ("monitor", "--for"), ("record", "--for"),
                    ("ctl", "stop", "--for"), ("ident", "x", "--track"), ("ident", "x", "--wheel-radius"),
                    ("ident", "x", "--relative-standard-error")]
        for words in positive:
            for value in ("-3", "0", "nan", "inf", "-1e300"):
                status, _, err = run(*words, value)
                self.assertEqual(status, 1, (words, value))
                self.assertIn(f"found {value}, expected a number greater than 0", err)
        for words, expected in ((("ctl", "stop", "--rate"), "from 0.1 to 1000"), (("ctl", "stop", "--alive"), "from 0 to 14"),
                                (("ctl", "ident", "--bit-time"), "from 0 to 255"), (("sim", "--rest"), "from 0 to 10000"), (("gap", "x.log", "--out", "y", "--heldout-from"), "from 0 to 1e9")):
            for value in ("-3", "20000" if "1e9" not in expected else "2e9", "nan"):
                status, _, err = run(*words, value)
                self.assertEqual(status, 1, (words, value))
                self.assertIn(f"found {value}, expected a number {expected}", err)
        for action in ("wait:-3", "velocity:0.1,0,0", "wait:nan", "goal:inf,0,0", "adaptive:-1", "wait:1e300",
                       "payload:-2", "payload:-1", "payload:1e9", "velocity:1e9,0,1", "velocity:0,-1e9,1",
                       "torque:0,33,1", "goal:0,1e9,0"):
            status, _, err = run("sim", action)
            self.assertEqual(status, 1, action)
            self.assertLess(len(err), 120, err)

    def test_a_mode_that_is_not_entered_comes_with_the_reason(self):
        status, out, _ = run("sim", "adaptive:1")
        self.assertEqual(status, 3)
        self.assertIn("blocked by model_not_trusted\n", out)
        with tempfile.NamedTemporaryFile("w", suffix=".toml") as robot:
            with open(os.path.join(SOURCE, "tools/robots/default.toml"), encoding="utf-8") as default:
                robot.write(re.sub(r"^generation = 6", "generation = 5", default.read(), flags=re.M))
            robot.flush()
            status, out, _ = run("sim", "--robot", robot.name, "velocity:0.1,0,1")
            self.assertEqual(status, 3)
            self.assertIn("fault arming_refused, blocked by drives_not_armed; the left drive's frames are not those of "
                          "the generation in the robot file: check drive.generation\n", out)
        self.assertNotIn("because of", run("sim", "velocity:0.1,0,1")[1])

    def test_no_refusal_is_longer_than_a_line(self):
        _, out, _ = run("--help")
        commands = [(name,) for name in re.findall(r"^  ([\w-]+)  +\S", out.split("Subcommands:")[1], re.M)]
        _, out, _ = run("ctl", "--help")
        commands += [("ctl", name) for name in re.findall(r"^  ([\w-]+)  +\S", out.split("Subcommands:")[1], re.M)]
        tried = 0
        for command in commands:
            _, out, _ = run(*command, "--help")
            for option in re.findall(r"(--[a-z-]+) (?:FLOAT|INT|UINT)", out):
                status, _, err = run(*command, option, "-1e300x")
                self.assertEqual(status, 1, (command, option))
                self.assertLess(len(err.splitlines()[0]), 160, (command, option, err))
                tried += 1
        self.assertGreater(tried, 10)

    def test_missing_interface_is_4_and_one_sentence(self):
        with tempfile.TemporaryDirectory() as folder:
            for arguments in (("ctl", "mode", "idle"), ("ctl", "velocity", "0", "0"), ("ctl", "stop"),
                              ("ctl", "param", "get", "geometry.track_m"), ("monitor",),
                              ("record", "--out", os.path.join(folder, "x.log"))):
                status, out, err = run(*arguments, "--can", "nocan7")
                self.assertEqual((status, out), (4, ""), arguments)
                self.assertEqual(err.count("\n"), 1, err)
            self.assertEqual(os.listdir(folder), [])

    def test_unusable_logs_are_2(self):
        with tempfile.NamedTemporaryFile("w", suffix=".log") as log:
            log.write("(1.000000) can0 620#01000000000000\nrubbish\n(0.500000) can0 123#\n")
            log.flush()
            status, _, err = run("monitor", "--log", log.name)
            self.assertEqual(status, 2)
            self.assertIn(f"{log.name}:2: does not begin with (time)", err)
            self.assertIn(f"{log.name}:3: time goes back by 500000 microseconds", err)
        status, _, err = run("monitor", "--log", "-", text="(1.000000) can0 123#00\n")
        self.assertEqual(status, 2)
        self.assertIn("no frame of ours", err)
        self.assertEqual(run("monitor", "--log", "/nowhere.log")[0], 2)


class Print(unittest.TestCase):
    def line(self, *arguments):
        status, out, err = run("ctl", *arguments, "--print")
        self.assertEqual((status, err), (0, ""), arguments)
        lines = out.splitlines()
        self.assertEqual(len(lines), 1)
        return decode(lines[0])

    def check(self, arguments, message, **expected):
        _, name, values = self.line(*arguments)
        self.assertEqual(name, message)
        for signal, value in expected.items():
            self.assertAlmostEqual(float(values[signal]), value, delta=abs(value) * 1e-6 + 1e-9,
                                   msg=f"{name}.{signal}")

    def test_modes_go_by_name(self):
        names = ["boot", "idle", "torque", "ident", "velocity", "pose", "trajectory", "adaptive"]
        for number in range(1, 8):
            self.check(("mode", names[number]), "ModeCommand", Mode=number, Alive=0)

    def test_setpoints_have_their_values(self):
        self.check(("torque", "-1.25", "3.5"), "TorqueCommand", LeftTorque=-1.25, RightTorque=3.5)
        self.check(("velocity", "0.35", "-0.7"), "VelocityCommand", ForwardSpeed=0.35, YawRate=-0.7)
        for number, direction in enumerate(("forward", "reverse", "automatic")):
            self.check(("goal", "1.5", "-2", "3.1", "--direction", direction), "PoseGoal", X=1.5, Y=-2,
                       Heading=3.1, Direction=number)
        self.check(("pose", "-12.25", "60.5", "-3.1"), "ExternalPose", X=-12.25, Y=60.5, Heading=-3.1)
        self.check(("trajectory", "circle", "--length", "2.5", "--period", "12"), "TrajectoryCommand", Shape=2,
                   Length=2.5, Period=12)
        self.check(("trajectory", "figure_eight"), "TrajectoryCommand", Shape=0, Length=3, Width=1.5, Period=10)
        self.check(("ident", "--amplitude", "4", "--bit-time", "20", "--duration", "30", "--speed-limit", "0.5",
                    "--yaw-rate-limit", "3", "--distance-limit", "1.2"), "IdentSettings", Amplitude=4, BitTime=20,
                   Duration=30, SpeedLimit=0.5, YawRateLimit=3, DistanceLimit=1.2)
        self.check(("ident",), "IdentSettings", Amplitude=0, BitTime=0, Duration=0)
        self.check(("clear",), "ClearFault", Alive=0)
        self.assertEqual(self.line("stop")[1], "EmergencyStop")

    def test_parameters_have_their_index_and_value(self):
        self.check(("param", "get", "dynamics.k7_per_kg_m"), "ParameterRequest", Operation=0, Index=0x82)
        self.check(("param", "get", "effects.coulomb_friction.left_Nm"), "ParameterRequest", Index=0x4010)
        self.check(("param", "set", "limits.torque_Nm", "4.5"), "ParameterRequest", Operation=1, Index=0x10,
                   Value=4.5)
        for number, name in ((2, "commit"), (3, "discard"), (4, "save")):
            self.check(("param", name), "ParameterRequest", Operation=number)

    def test_a_limit_typed_exactly_is_not_rounded_out_of_range(self):
        # 0.1 as a float is above 0.1, which the firmware would refuse
        _, _, values = self.line("param", "set", "pose_control.stop_radius_m", "0.1")
        self.assertLessEqual(float(values["Value"]), 0.1)
        self.assertGreater(float(values["Value"]), 0.0999999)
        self.assertGreater(struct.unpack("f", struct.pack("f", 0.1))[0], 0.1)

    def test_counter_interface_and_both_lines_of_enter(self):
        interface, _, values = self.line("--can", "vcan3", "--alive", "14", "mode", "idle")
        self.assertEqual((interface, int(values["Alive"])), ("vcan3", 14))
        status, out, _ = run("ctl", "velocity", "0.1", "0", "--enter", "--print", "--can", "vcan0")
        self.assertEqual(status, 0)
        lines = [decode(line) for line in out.splitlines()]
        self.assertEqual([name for _, name, _ in lines], ["VelocityCommand", "ModeCommand"])
        self.assertEqual(int(lines[1][2]["Mode"]), 4)
        _, out, _ = run("ctl", "param", "set", "limits.torque_Nm", "4", "--commit", "--print")
        lines = [decode(line) for line in out.splitlines()]
        self.assertEqual([int(values["Alive"]) for _, _, values in lines], [0, 1])

    def test_the_list_names_every_parameter(self):
        status, out, _ = run("ctl", "param", "list")
        self.assertEqual(status, 0)
        self.assertGreater(len(out.splitlines()), 100)
        self.assertIn("0x0003  geometry.track_m", out)


class Check(unittest.TestCase):
    def test_every_example_is_good(self):
        files = glob.glob(os.path.join(ROBOTS, "*.toml"))
        self.assertGreaterEqual(len(files), 4)
        for file in files:
            status, out, err = run("check", file)
            self.assertEqual((status, err), (0, ""), file)
            self.assertIn("(fits)", out)

    def test_figures_for_programs(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "figures.json")
            status, _, _ = run("check", os.path.join(ROBOTS, "default.toml"), "--json", path)
            self.assertEqual(status, 0)
            with open(path, encoding="utf-8") as file:
                figures = json.load(file)
        model = figures["model"]
        self.assertAlmostEqual(model["effective_mass_kg"], 9.466, places=3)
        self.assertAlmostEqual(model["effective_yaw_inertia_kg_m2"], 0.3164, places=4)
        self.assertAlmostEqual(model["energy_imbalance"], 0, places=12)
        self.assertTrue(math.isclose(figures["bus"]["drive_load_percent"], 54.0 + 4 * 1.35 / 2 + 0.54, abs_tol=0.01),
                        figures["bus"])

    def test_what_ident_will_do_is_said_as_far_as_the_file_tells(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "figures.json")
            status, out, _ = run("check", os.path.join(ROBOTS, "default.toml"), "--json", path)
            self.assertEqual(status, 0)
            with open(path, encoding="utf-8") as file:
                ident = json.load(file)["ident"]
        # 8/15 of 1.5 m a second; wheels 0.16 m from the middle as fast; the probe finds the torque.
        self.assertAlmostEqual(ident["speed_limit_m_per_s"], 0.8)
        self.assertAlmostEqual(ident["yaw_rate_limit_rad_per_s"], 5)
        self.assertEqual(ident["amplitude_Nm"], "auto")
        self.assertIn("at most limits.torque_Nm, 5 Nm", out)

    def test_bad_files_are_1_with_file_line_and_key(self):
        with tempfile.NamedTemporaryFile("w", suffix=".toml") as robot:
            robot.write("[geometry]\nwheel_radius_mm = 75\ntrack_m = 320\n")
            robot.flush()
            status, out, err = run("check", robot.name)
        self.assertEqual((status, out), (1, ""))
        lines = err.splitlines()
        self.assertEqual(len(lines), 2)
        self.assertTrue(lines[0].startswith(f"{robot.name}:2:1: geometry.wheel_radius_mm: unknown key"))
        self.assertTrue(lines[1].startswith(f"{robot.name}:3:11: geometry.track_m: found 320 m, expected"))
        self.assertEqual(run("check", "/nowhere.toml")[0], 1)

    def test_a_pipe_is_refused_and_many_unknown_keys_take_their_number_of_times(self):
        with tempfile.TemporaryDirectory() as folder:
            pipe = os.path.join(folder, "robot.toml")
            os.mkfifo(pipe)
            status, _, err = run("check", pipe)  # nobody writes into it
            self.assertEqual((status, err), (1, f"{pipe}: is a pipe or a device, expected a file on a disk\n"))
            many = os.path.join(folder, "many.toml")
            with open(many, "w", encoding="utf-8") as robot:
                robot.writelines(f"unheard_of_{i} = 1\n" for i in range(10000))
            status, _, err = run("check", many)  # a second; run() gives it 20
            self.assertEqual((status, len(err.splitlines())), (1, 10000))

    def test_the_page_of_the_robot_file_is_the_programs_reference(self):
        status, out, _ = run("check", "--explain")
        self.assertEqual(status, 0)
        with open(os.path.join(SOURCE, "docs/robot-file.md"), encoding="utf-8") as file:
            page = file.read()
        self.assertEqual(page[page.index("## Parameters"):], out,
                         f"bring docs/robot-file.md up to date: {sys.executable} {sys.argv[0]} {PROGRAM} {SOURCE} --write-page")


class Key(unittest.TestCase):
    def test_a_key_is_made_checked_and_installed_and_never_printed(self):
        with tempfile.TemporaryDirectory() as folder:
            key, robot = os.path.join(folder, "robot.key"), os.path.join(folder, "robot.toml")
            shutil.copy(os.path.join(ROBOTS, "default.toml"), robot)
            said = ""

            def tried(expected, *words):
                nonlocal said
                status, out, err = run("key", *words)
                self.assertEqual(status, expected, (words, out, err))
                said += out + err
                return out + err

            tried(0, "generate", key, "--robot", "cart 7")
            self.assertEqual(os.stat(key).st_mode & 0o7777, 0o600)
            self.assertIn("File exists", tried(1, "generate", key))
            self.assertIn("good, for robot cart 7", tried(0, "check", key))
            self.assertIn("arming.key_file names it", tried(0, "install", key, "--config", robot))
            with open(robot, "rb") as file:
                self.assertEqual(tomllib.load(file)["arming"]["key_file"], key)
            self.assertEqual(run("check", robot)[0], 0)
            os.chmod(key, 0o644)
            for words in (("check", key), ("install", key, "--config", robot)):
                self.assertIn(f"{key}: others may use this key: found mode 0644, expected 0600", tried(1, *words))
            self.assertIn("0644", run("ctl", "--key", key, "mode", "torque")[2])
            os.chmod(key, 0o600)
            tried(0, "generate", key + "2")
            with open(key, encoding="ascii") as one, open(key + "2", encoding="ascii") as other:
                secrets = [re.search(r"^key ([0-9a-f]{32})$", file.read(), re.M)[1] for file in (one, other)]
            self.assertNotEqual(*secrets)
            for secret in secrets:
                self.assertNotIn(secret, said)
            self.assertIn("expected a name", tried(1, "generate", key + "3", "--robot", ""))
            self.assertEqual(run("ctl", "--key", key, "mode", "torque", "--print")[0], 1)


class Monitor(unittest.TestCase):
    def test_a_log_of_an_identification_holds_what_it_found_and_chose(self):
        with tempfile.NamedTemporaryFile(suffix=".log") as log:
            self.assertEqual(run("sim", "--log", log.name, "ident")[0], 0)
            status, out, _ = run("monitor", "--log", log.name)
        self.assertEqual(status, 0)
        self.assertRegex(out, r"found: the wheels move at [0-9.]+ Nm \(left\)")
        self.assertRegex(out, r"chosen: [0-9.]+ Nm in bits of [0-9]+ ms, averaged over [0-9.]+ ms, up to ")

    def log(self, *frames):
        """A log of our frames, encoded by canmatrix, 20 ms apart."""
        lines = []
        for number, (name, values) in enumerate(frames):
            frame = DBC.frame_by_name(name)
            complete = {signal.name: 0 for signal in frame.signals}
            for signal, value in values.items():
                complete[signal] = frame.signal_by_name(signal).phys2raw(decimal.Decimal(str(value)))
            data = frame.encode(complete)
            lines.append(f"(1700000000.{number * 20000:06d}) can0 {frame.arbitration_id.id:03X}#{data.hex().upper()}\n")
        return "".join(lines)

    def test_a_log_is_told_by_state_and_summed_up(self):
        text = self.log(("Status", {"State": 1, "Requested": 1}),
                        ("Odometry", {"X": 1.25, "Y": -0.5, "Heading": 0.75}),
                        ("Status", {"State": 4, "Requested": 4}),
                        ("Status", {"State": 8, "Requested": 8, "Fault": 5}))
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "figures.json")
            status, out, err = run("monitor", "--log", "-", "--json", path, text=text)
            self.assertEqual((status, err), (0, ""))
            with open(path, encoding="utf-8") as file:
                figures = json.load(file)
        self.assertIn("idle", out.splitlines()[0])
        self.assertRegex(out, r"0\.040 s +velocity +x 1\.2500 y -0\.5000 m heading 0\.7500 rad")
        self.assertRegex(out, r"0\.060 s +fault +fault over_speed")
        self.assertEqual(figures["last"]["state"], "fault")
        self.assertEqual(figures["last"]["fault"], "over_speed")
        self.assertAlmostEqual(figures["last"]["x_m"], 1.25)
        status = figures["log"]["messages"][0]
        self.assertEqual((status["name"], status["frames"], status["bad"]), ("Status", 3, 0))
        self.assertAlmostEqual(status["rate_Hz"], 50)

    def test_all_shows_every_message_with_names_and_units(self):
        text = self.log(("WheelState", {"LeftSpeed": -12.5, "RightTorque": 3.25}))
        status, out, _ = run("monitor", "--log", "-", "--all", text=text)
        self.assertEqual(status, 0)
        self.assertIn("WheelState  left_speed_rad_per_s -12.500", out)
        self.assertIn("right_torque_Nm 3.250", out)


def write_page():
    path = os.path.join(SOURCE, "docs/robot-file.md")
    with open(path, encoding="utf-8") as file:
        page = file.read()
    with open(path, "w", encoding="utf-8") as file:
        file.write(page[:page.index("## Parameters")] + run("check", "--explain")[1])


if __name__ == "__main__":
    if sys.argv[3:] == ["--write-page"]:
        sys.exit(write_page())
    unittest.main(argv=[sys.argv[0]])
