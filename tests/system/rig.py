"""What the system tests share: the firmware and the simulated robot as processes on a real vcan0, driven by
Debian's can-utils (cansend, canplayer) and watched by candump; frames coded by canmatrix, not by us.

Every wait is for a condition, with a deadline; no test sleeps and hopes. The machine is user-mode Linux with a time of
its own (toolchain/uml/run --steady), in which nothing is late. So the firmware gets tools/robots/default.toml and the
simulated robot simulated.toml as they are; a case that needs another value says which and why.
"""
import functools
import json
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tomllib
import unittest

LONG = 20  # s: how long a condition is waited for that ought to hold within a second

NEEDED = {"candump": "can-utils", "cansend": "can-utils", "canplayer": "can-utils", "ip": "iproute2",
          "chrt": "util-linux"}


def program_folder():
    return os.environ.get("WHEELWRIGHT_BIN", os.path.join(source_folder(), "build", "release", "bin"))


def source_folder():
    return os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))


def wheelwrightd():
    return os.path.join(program_folder(), "wheelwrightd")


def wheelwright():
    return os.path.join(program_folder(), "wheelwright")


def robots(name):
    return os.path.join(source_folder(), "tools", "robots", name)


for tool, package in NEEDED.items():
    if shutil.which(tool, path=os.environ["PATH"] + ":/usr/sbin:/sbin") is None:
        sys.exit(f"{tool} is missing: apt-get install {package}")
os.environ["PATH"] += ":/usr/sbin:/sbin"
try:
    stderr = os.dup(2)
    with open(os.devnull, "w", encoding="ascii") as null:  # it complains about formats that nobody asked for
        os.dup2(null.fileno(), 2)
        import canmatrix.formats
finally:
    os.dup2(stderr, 2)
    os.close(stderr)


# ---- robot files ------------------------------------------------------------------------------------------------


def edited(text, values):
    """The text of a robot file with {"table.key": value} put in place; comments stay."""
    for path, value in values.items():
        table, key = path.rsplit(".", 1)
        literal = json.dumps(value)
        head = re.search(rf"^\[{re.escape(table)}\].*\n", text, re.M)
        if head is None:
            text += f"\n[{table}]\n{key} = {literal}\n"
            continue
        end = re.compile(r"^\[", re.M).search(text, head.end())
        end = end.start() if end else len(text)
        body = text[head.end():end]
        line = re.compile(rf'^{re.escape(key)}(\s*)=(\s*)("[^"]*"|[^\s#]+)', re.M)
        if line.search(body):
            body = line.sub(lambda m: f"{key}{m[1]}={m[2]}{literal}", body)
        else:
            body = f"{key} = {literal}\n" + body
        text = text[:head.end()] + body + text[end:]
    parsed = tomllib.loads(text)
    for path, value in values.items():
        at = parsed
        for part in path.split("."):
            at = at[part]
        assert at == value, (path, at, value)
    return text


def limit(path):
    """The number at "table.key" of default.toml, or if it is not there the default of docs/robot-file.md."""
    with open(robots("default.toml"), "rb") as file:
        at = tomllib.load(file)
    for part in path.split("."):
        at = at.get(part, {})
    if at != {}:
        return at
    with open(os.path.join(source_folder(), "docs", "robot-file.md"), encoding="utf-8") as file:
        return float(re.search(rf"^\| 0x\w+ \| `{re.escape(path)}` \|[^|]*\|([^|]*)\|", file.read(), re.M)[1])


def write_robot_file(path, source, values):
    with open(robots(source), encoding="utf-8") as file:
        text = edited(file.read(), values)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


# ---- frames -----------------------------------------------------------------------------------------------------


def crc8(data):
    """CRC-8 SAE J1850, from its definition: polynomial 0x1D, start 0xFF, final exclusive-or 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


class Dbc:
    def __init__(self, path):
        self.matrix = list(canmatrix.formats.loadp(os.path.join(source_folder(), path)).values())[0]
        self.frames = {frame.name: frame for frame in self.matrix.frames}
        self.by_id = {frame.arbitration_id.id: frame for frame in self.matrix.frames}

    def encode(self, name, **values):
        """Physical values, or names of value tables; what is left out is 0."""
        frame = self.frames[name]
        raw = {}
        for one in frame.signals:
            value = values.pop(one.name, 0)
            if isinstance(value, str):
                value = next(number for number, text in one.values.items() if text == value)
            elif not one.is_float:
                value = round((value - float(one.offset)) / float(one.factor))
            raw[one.name] = value
        assert not values, values
        return bytearray(frame.encode(raw)) if raw else bytearray()

    def sealed(self, name, alive, **values):
        data = self.encode(name, Alive=alive, **values)
        data[0] = crc8(data[1:])
        return data

    def decode(self, number, data):
        """{signal: value}, value tables as text."""
        frame = self.by_id[number]
        assert len(data) == frame.size, f"{frame.name}: {len(data)} bytes"
        result = {}
        for name, one in frame.decode(bytearray(data)).items():
            value = float(one.phys_value)
            result[name] = one.signal.values.get(int(value), value) if one.signal.values else value
        return result


DBC = Dbc("firmware/protocol/wheelwright.dbc")


def number_of(name):
    return DBC.frames[name].arbitration_id.id


# The drives' frames (CANSimple): node << 5 | command.
NODES = {"left": 1, "right": 2}
HEARTBEAT, ESTOP, SET_AXIS_STATE, ENCODER, SET_INPUT_TORQUE = 0x01, 0x02, 0x07, 0x09, 0x0E
WATCHDOG_EXPIRED = 0x01000000  # CANSimple 0.6


def drive_id(side, command):
    return NODES[side] << 5 | command


# ---- commands ---------------------------------------------------------------------------------------------------


@functools.cache
def small_shell():
    """To start a program, user-mode Linux first copies the starter's memory, and meanwhile stands still: for some
    milliseconds when that is this Python. So a shell starts what is started often."""
    return subprocess.Popen(["sh"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0)


def shell(line):
    """Runs a line of shell whose output does not matter; returns its exit status."""
    small_shell().stdin.write(f"{line} >/dev/null </dev/null; echo $?\n".encode())
    return int(small_shell().stdout.readline())


# ---- the bus ----------------------------------------------------------------------------------------------------


# What candump listens to unless a test wants more: each frame costs a slow machine, and the drives' cyclic ones are
# most of them. Heartbeats, requested states, all commands, the telemetry that is looked at, the tests' own marker.
USUAL = [f"{NODES[side] << 5 | command:03X}:7FF" for side in NODES for command in (HEARTBEAT, SET_AXIS_STATE)]
USUAL += ["600:7E0", "7FF:7FF"]
USUAL += [f"{number_of(name):03X}:7FF" for name in (
    "Status", "Counters", "WheelState", "EstimateK5K7", "EstimateK6K8", "StandardErrorK5K7", "StandardErrorK6K8",
    "IdentStatus", "Timing", "ParameterReply")]
TORQUES = [f"{NODES[side] << 5 | command:03X}:7FF" for side in NODES for command in (SET_INPUT_TORQUE, SET_AXIS_STATE)]
MARKER = 0x7FF


class Bus:
    """candump of one interface, as it grows. Times are the kernel's, in seconds of the wall clock."""

    LINE = re.compile(r"\((\d+\.\d+)\) \w+ ([0-9A-F]+)#(\S*)")

    def __init__(self, interface, path, filters):
        self.interface = interface
        self.frames = {}  # id: [(time, hexadecimal data)]
        self.rest = ""
        self.output = open(path, "w", encoding="ascii")
        # -D: go on when the interface goes down.
        self.process = subprocess.Popen(["candump", "-L", "-D", "-r", "32000000", ",".join([interface, *filters])],
                                        stdout=self.output, stderr=subprocess.DEVNULL)
        self.input = open(path, encoding="ascii")
        until(lambda: self.cansend(MARKER, b"") or self.frames.get(MARKER) or self.poll(),
              "candump sees what cansend sends")

    def end(self):
        self.process.kill()
        self.process.wait()
        self.output.close()
        self.input.close()

    def poll(self):
        text = self.rest + self.input.read()
        cut = text.rfind("\n") + 1
        self.rest = text[cut:]
        for when, number, data in self.LINE.findall(text[:cut]):
            self.frames.setdefault(int(number, 16), []).append((float(when), data))

    def of(self, what, since=0.0):
        """[(time, bytes)] of a message's name or an id."""
        self.poll()
        number = number_of(what) if isinstance(what, str) else what
        found = self.frames.get(number, [])
        first = len(found)
        while first > 0 and found[first - 1][0] >= since:
            first -= 1
        return [(when, bytes.fromhex(data)) for when, data in found[first:] if not data.startswith("R")]

    def cansend(self, number, data):
        """`data`: bytes, or text that cansend understands."""
        text = data if isinstance(data, str) else bytes(data).hex().upper()
        shell(f"cansend {self.interface} {number:03X}#{text}")

    def latest(self, name):
        """The last frame of a message, decoded, with its Time; None before the first."""
        self.poll()
        found = self.frames.get(number_of(name))
        if not found:
            return None
        return {"Time": found[-1][0], **DBC.decode(number_of(name), bytes.fromhex(found[-1][1]))}


class SleepingBus(Bus):
    """The same, but candump is stopped unless somebody looks: meanwhile the kernel keeps the frames for it. For the
    torques, two frames each millisecond: a machine on which to switch processes takes long would be busy with them."""

    def __init__(self, interface, path):
        super().__init__(interface, path, [*TORQUES, f"{MARKER:03X}:7FF"])
        self.marker = 0
        self.process.send_signal(signal.SIGSTOP)

    def catch_up(self):
        """Everything up to now can be read."""
        self.marker += 1
        data = self.marker.to_bytes(4, "big").hex().upper()
        self.process.send_signal(signal.SIGCONT)
        self.cansend(MARKER, data)
        until(lambda: self.poll() or any(seen == data for _, seen in self.frames.get(MARKER, [])[-20:]),
              "candump has caught up")
        self.process.send_signal(signal.SIGSTOP)


def until(condition, what, seconds=LONG, details=None):
    """Polls until the condition is true, and returns what it returned."""
    deadline = time.monotonic() + seconds
    while True:
        result = condition()
        if result:
            return result
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {seconds} s: {what}" + (f"\n{details()}" if details else ""))
        time.sleep(0.02)


# ---- the rig ----------------------------------------------------------------------------------------------------


class Rig:
    """A robot, the firmware, and a host made of can-utils, on `interface`."""

    def __init__(self, interface="vcan0", host_interface=None, filters=USUAL):
        self.folder = tempfile.mkdtemp(prefix="wheelwright_")
        self.attending = None
        self.interface = interface
        self.drives = Bus(interface, self.file("drives.log"), filters)
        self.host = self.drives
        if host_interface is not None:
            self.host = Bus(host_interface, self.file("host.log"), filters)
        self.torque_bus = None
        self.processes = []
        self.alive = {}
        self.robot = self.daemon = None
        self.robot_file = self.file("robot.toml")
        self.trace_path = self.file("truth.csv")

    def file(self, name):
        return os.path.join(self.folder, name)

    def end(self):
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()
            process.wait()
        self.drives.end()
        if self.torque_bus is not None:
            self.torque_bus.end()
        if self.host is not self.drives:
            self.host.end()
        shutil.rmtree(self.folder)

    def popen(self, command, name):
        output = open(os.path.join(self.folder, name), "wb")
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
        output.close()
        process.name = name
        self.processes.append(process)
        return process

    def said(self, process):
        with open(os.path.join(self.folder, process.name), encoding="utf-8", errors="replace") as file:
            return file.read()

    def lives(self, process):
        """True, or an AssertionError with what the process said."""
        if process.poll() is not None:
            raise AssertionError(f"ended with status {process.returncode}: {self.said(process)}")
        return True

    # The robot.

    def start_robot(self, *options, **values):
        """`values`: of the plant's file, with __ for the dot."""
        plant = self.file("plant.toml")
        write_robot_file(plant, "simulated.toml", dotted(values))
        # A robot does not wait for the host's processor: where it may, it is real-time, below the firmware.
        self.robot = self.popen([*realtime(40), wheelwright(), "sim", "--can", self.interface, "--plant", plant,
                                 "--trace", self.trace_path, *options], "robot.txt")
        started = time.time()
        until(lambda: self.lives(self.robot) and self.drives.of(drive_id("right", HEARTBEAT), started),
              "the robot's drives are heard")

    def stop_robot(self, how=signal.SIGTERM):
        self.robot.send_signal(how)
        return self.robot.wait(LONG)

    def truth(self, since=None):
        """Rows [time, x, y, heading, speed, yaw rate] of what the robot really did; without `since` the last one."""
        # A row is not longer than 80 bytes and comes every 10 ms at most; the first one read may be half of one.
        length = 400 if since is None else int(max(0, time.time() - since) * 8000) + 2000
        with open(self.trace_path, encoding="ascii") as file:
            file.seek(max(0, os.path.getsize(self.trace_path) - length))
            lines = file.read().splitlines(keepends=True)
        rows = [[float(x) for x in line.split(",")] for line in lines[1:] if line.endswith("\n")]
        return rows[-1] if since is None else [row for row in rows if row[0] >= since]

    def at_rest(self):
        row = self.truth()
        return abs(row[4]) < 0.005 and abs(row[5]) < 0.02

    # The firmware.

    def write_robot_file(self, **values):
        write_robot_file(self.robot_file, "default.toml", dotted(values))

    def start_daemon(self, *options, **values):
        self.write_robot_file(**values)
        self.launch_daemon(*options)

    def launch_daemon(self, *options):
        """With the robot file as it is."""
        if not may_be_realtime():
            options = (*options, "--allow-soft-realtime")
        started = time.time()
        self.daemon = self.popen([wheelwrightd(), "--config", self.robot_file, "--can", self.interface, *options],
                                 "wheelwrightd.txt")
        self.until(lambda: self.lives(self.daemon) and self.host.of("Status", started), "the firmware runs")
        self.until_status(lambda s: s["State"] == "idle" and s["DriveLeft"] == s["DriveRight"] == "idle",
                          "it sees both drives idle")

    def memory_MB(self):
        """What the firmware holds in memory; printed, as docs/target.md gives it."""
        with open(f"/proc/{self.daemon.pid}/status", encoding="ascii") as file:
            MB = int(re.search(r"^VmRSS:\s+(\d+) kB", file.read(), re.M)[1]) / 1024
        print(f"wheelwrightd holds {MB:.1f} MB")
        return MB

    def stop_daemon(self, how=signal.SIGTERM):
        self.daemon.send_signal(how)
        return self.daemon.wait(LONG)

    # What the host says.

    def next_alive(self, name):
        """Another than our last one, and than that of whoever else sends: the firmware takes equal ones for one."""
        alive = (self.alive.get(name, -1) + 1) % 15
        others = self.host.latest(name)
        if others is not None and alive == others["Alive"]:
            alive = (alive + 1) % 15
        self.alive[name] = alive
        return alive

    def send(self, name, **values):
        """One frame by cansend."""
        frame = DBC.frames[name]
        if any(one.name == "Alive" for one in frame.signals):
            data = DBC.sealed(name, self.next_alive(name), **values)
        else:
            data = DBC.encode(name, **values)
        self.host.cansend(frame.arbitration_id.id, data)

    def stream(self, name, period_s, after_1_s=None, **values):
        """A set-point repeated by canplayer, until its end() is called; `after_1_s`: the values from then on."""
        self.processes = [one for one in self.processes if one.poll() is None or one is self.daemon]
        path = os.path.join(self.folder, f"{name}_{len(os.listdir(self.folder))}.log")
        frames, later = ([DBC.sealed(name, alive, **one).hex().upper() for alive in range(15)]
                         for one in (values, after_1_s or values))
        with open(path, "w", encoding="ascii") as file:
            for i in range(int(120 / period_s)):
                file.write(f"({i * period_s:.6f}) {self.host.interface} {number_of(name):03X}#{(frames if i * period_s < 1 else later)[i % 15]}\n")
        started = time.time()
        process = self.popen([*realtime(60), "canplayer", "-g", "10", "-I", path], os.path.basename(path) + ".txt")
        until(lambda: self.host.of(name, started), f"{name} is on the bus")
        return process

    def attend(self):
        """Says for two minutes that the host is there: what drives without set-points needs that."""
        if self.attending is not None:
            self.end_stream(self.attending)
        self.attending = self.stream("HostAlive", 0.1)

    def end_stream(self, process):
        process.kill()
        process.wait()

    # What the firmware answers.

    def status(self):
        return self.host.latest("Status") or {}

    def describe(self):
        status = self.status()
        timing = self.host.latest("Timing")
        text = f"last Status: {status}\nlast Timing: {timing}"
        if self.daemon is not None:
            text += f"\nwheelwrightd ({self.daemon.poll()}): {self.said(self.daemon)}"
        return text

    def until(self, condition, what, seconds=LONG):
        return until(condition, what, seconds, self.describe)

    def until_status(self, condition, what, seconds=LONG):
        def look():
            status = self.status()
            return status if status and condition(status) else None
        return self.until(look, what, seconds)

    def until_state(self, state, seconds=LONG):
        def entered(status):
            if status["State"] == "fault":
                raise AssertionError(f"{status['Fault']} while waiting for {state}\n{self.describe()}")
            return status["State"] == state
        return self.until_status(entered, f"state {state}", seconds)

    def until_fault(self, fault, seconds=LONG):
        def faulted(status):
            if status["State"] == "fault" and status["Fault"] != fault:
                raise AssertionError(f"{status['Fault']} while waiting for {fault}\n{self.describe()}")
            return status["State"] == "fault"
        return self.until_status(faulted, f"fault {fault}", seconds)

    def mode(self, mode):
        """Asks for a mode and waits until the robot is in it."""
        if mode in ("ident", "trajectory", "adaptive"):
            self.attend()
        self.send("ModeCommand", Mode=mode)
        return self.until_state(mode)

    def recover(self):
        """Idle and at rest, whatever the last test left behind."""
        if self.daemon is None or self.daemon.poll() is not None:
            self.start_daemon()
        if self.status()["State"] == "fault":
            self.clear_fault()
        elif self.status()["State"] != "idle":
            self.mode("idle")
        self.until(self.at_rest, "the robot stands")

    def clear_fault(self):
        """Waits until the robot stands, clears the fault, and waits for idle."""
        self.until(self.at_rest, "the robot stands")
        def cleared():
            self.send("ClearFault")
            time.sleep(0.1)  # between two attempts; what counts is the state
            status = self.status()
            return status["State"] == "idle" and status["DriveLeft"] == status["DriveRight"] == "idle"
        self.until(cleared, "the fault is cleared")

    def missed_cycles(self):
        """Since the firmware's start, as reported from now on."""
        now = time.time()
        self.until(lambda: self.host.of("Timing", now), "timing")
        return self.host.latest("Timing")["MissedCycles"]

    # What the drives were told.

    def watch_torques(self):
        """From now on the torques are recorded. For some seconds only: they are 2000 frames in each."""
        if self.torque_bus is not None:
            self.torque_bus.end()
        self.torque_bus = SleepingBus(self.interface, self.file("torques.log"))

    def torques(self, since):
        """{side: [(time, Nm at the wheel)]} as commanded; the example robot's gear is 8, its signs are 1."""
        self.torque_bus.catch_up()
        return {side: [(when, 8 * struct.unpack("<f", data[:4])[0])
                       for when, data in self.torque_bus.of(drive_id(side, SET_INPUT_TORQUE), since)]
                for side in NODES}

    def told_idle(self, side, since):
        """When the drive was asked for the state idle."""
        return [when for when, data in self.drives.of(drive_id(side, SET_AXIS_STATE), since) if data[0] == 1]

    def heartbeat(self, side):
        """(time, error bits, axis state) as the drive reported last."""
        when, data = self.drives.of(drive_id(side, HEARTBEAT))[-1]
        error, state = struct.unpack("<IB", data[:5])
        return when, error, state


def dotted(values):
    return {key.replace("__", "."): value for key, value in values.items()}


@functools.cache
def may_be_realtime():
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    return (soft == hard == resource.RLIM_INFINITY or os.geteuid() == 0) and subprocess.run(
        ["chrt", "-f", "80", "true"], capture_output=True, check=False).returncode == 0


def realtime(priority):
    """What to put before a command."""
    return ["chrt", "-f", str(priority)] if may_be_realtime() else []


def main():
    unittest.main(verbosity=2)
