"""What keeps the firmware and the simulated robot from starting: one sentence, what to do, and the exit status."""
import ctypes
import os
import platform
import resource
import shutil
import signal
import struct
import subprocess
import tempfile
import time
import unittest

import rig

NOBODY = 65534


def run(*arguments, program=None, before=None, seconds=30):
    done = subprocess.run([program or rig.wheelwrightd(), *arguments], capture_output=True, text=True,
                          timeout=seconds, preexec_fn=before, check=False)
    return done.returncode, done.stdout, done.stderr


def become_nobody():
    """An ordinary user without a right to real time."""
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
        resource.setrlimit(limit, (0, 0))
    if os.geteuid() == 0:
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        except OSError:
            pass  # root of a user namespace with one user: has no rights outside it anyway


def forbid_can_sockets():
    """What a container or a service does that is not allowed AF_CAN: socket() answers EPERM."""
    load, jump_equal, answer = 0x20, 0x15, 0x06
    program = b"".join(struct.pack("HBBI", *one) for one in (
        (load, 0, 0, 0),                     # the call's number
        (jump_equal, 0, 3, 41),              # socket()
        (load, 0, 0, 16),                    # its first argument
        (jump_equal, 0, 1, 29),              # AF_CAN
        (answer, 0, 0, 0x00050000 | 1),      # EPERM
        (answer, 0, 0, 0x7FFF0000)))         # allowed
    buffer = ctypes.create_string_buffer(program)
    libc = ctypes.CDLL(None, use_errno=True)
    filters = struct.pack("HxxxxxxP", 6, ctypes.addressof(buffer))
    if libc.prctl(38, 1, 0, 0, 0) != 0 or libc.prctl(22, 2, filters, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")


class Start(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        os.chmod(folder.name, 0o755)
        cls.good = os.path.join(folder.name, "robot.toml")
        rig.write_robot_file(cls.good, "default.toml", {})
        # Nobody may not look into a home directory, in which the program may lie.
        cls.for_nobody = shutil.copy(rig.wheelwrightd(), folder.name)
        os.chmod(cls.for_nobody, 0o755)

    def refused(self, status, *words, of, one_line=True):
        """The run ended with this status and said these words, in one line, on standard error only."""
        self.assertEqual((of[0], of[1]), (status, ""), of)
        for word in words:
            self.assertIn(word, of[2])
        if one_line:
            self.assertEqual(of[2].count("\n"), 1, of[2])

    def test_an_interface_that_does_not_exist(self):
        for program, arguments in ((rig.wheelwrightd(), ("--config", self.good)),
                                   (rig.wheelwright(), ("sim", "--plant", rig.robots("simulated.toml")))):
            self.refused(4, "There is no interface can9", "ip link",
                         of=run(*arguments, "--can", "can9", program=program))
        self.refused(4, "There is no interface can9",
                     of=run("--config", self.good, "--can", "vcan0", "--host-can", "can9"))

    def test_an_interface_that_is_down(self):
        subprocess.run(["ip", "link", "add", "vcan7", "type", "vcan"], check=True)
        try:
            self.refused(4, "vcan7 is down", "ip link set vcan7 up", of=run("--config", self.good, "--can", "vcan7"))
            self.refused(4, "vcan7 is down", of=run("sim", "--can", "vcan7", program=rig.wheelwright()))
        finally:
            subprocess.run(["ip", "link", "delete", "vcan7"], check=True)

    def test_what_is_no_can_interface(self):
        self.refused(1, "lo is not a CAN interface", of=run("--config", self.good, "--can", "lo"))

    @unittest.skipUnless(platform.machine() == "x86_64", "numbers of system calls of x86-64")
    def test_can_sockets_are_forbidden(self):
        self.refused(4, "No permission to open a CAN socket", "run as root",
                     of=run("--config", self.good, "--can", "vcan0", before=forbid_can_sockets))

    def test_a_bad_robot_file_is_named_by_file_line_and_key(self):
        with open(self.good, encoding="utf-8") as file:
            good = file.read()
        line_of = lambda text, start: next(i for i, line in enumerate(text.splitlines(), 1) if line.startswith(start))
        for old, new, words in (
                ("track_m = 0.32", "track_mm = 320", ("geometry.track_mm", "unknown key")),
                ("track_m = 0.32", "track_m = 320", ("geometry.track_m", "expected a number from 0.02 to 5 m")),
                ("track_m = 0.32", 'track_m = "wide"', ("geometry.track_m", "expected a number")),
                ("track_m = 0.32", "track_m = nan", ("geometry.track_m", "expected")),
                ("track_m = 0.32", "track_m = ", ("robot.toml", ""))):
            bad = good.replace(old, new)
            self.assertNotEqual(bad, good)
            path = self.good.replace("robot.toml", "bad_robot.toml")
            with open(path, "w", encoding="utf-8") as file:
                file.write(bad)
            status, out, err = run("--config", path, "--can", "vcan0")
            self.assertEqual((status, out), (1, ""), err)
            self.assertTrue(err.startswith(f"{path}:{line_of(bad, new.split('=')[0].strip())}:"), err)
            for word in words:
                self.assertIn(word, err)

    def test_several_mistakes_are_named_at_once(self):
        path = self.good.replace("robot.toml", "bad_robot.toml")
        with open(path, "w", encoding="utf-8") as file:
            file.write("[geometry]\ntrack_m = 320\n[drive]\ngeneration = 7\n")
        status, _, err = run("--config", path, "--can", "vcan0")
        self.assertEqual(status, 1)
        self.assertIn("bad_robot.toml:2:", err)
        self.assertIn("bad_robot.toml:4:", err)

    def test_a_robot_file_that_cannot_be_read(self):
        self.refused(1, "missing.toml", of=run("--config", "missing.toml", "--can", "vcan0"))
        os.chmod(self.good, 0)
        try:
            if os.geteuid() == 0:
                self.refused(1, self.good, "ermission denied",
                             of=run("--config", self.good, "--can", "vcan0", program=self.for_nobody,
                                    before=become_nobody))
        finally:
            os.chmod(self.good, 0o644)

    def test_a_bus_too_small_for_the_traffic_is_refused_by_name(self):
        path = self.good.replace("robot.toml", "slow_bus.toml")
        rig.write_robot_file(path, "default.toml", {"bus.bit_rate_bit_per_s": 500000.0})
        self.refused(1, "Set_Input_Torque", "Get_Encoder_Estimates", "bus.load_limit",
                     of=run("--config", path, "--can", "vcan0"))

    def test_a_second_firmware_on_the_bus_is_refused_and_the_first_drives_on(self):
        one = rig.Rig()
        self.addCleanup(one.end)
        one.start_robot()
        one.start_daemon()
        stream = one.stream("VelocityCommand", 0.02, ForwardSpeed=0.2, YawRate=0)
        one.mode("velocity")
        status, out, err = run("--config", one.robot_file, "--can", "vcan0", "--allow-soft-realtime")
        self.assertEqual((status, out), (1, ""))
        self.assertIn("another wheelwrightd drives a robot on vcan0 (its telemetry, 0x620 to 0x62F, is heard)", err)
        self.assertEqual(one.status()["State"], "velocity")
        one.end_stream(stream)

    def test_usage(self):
        for arguments in ((), ("--config", self.good), ("--can", "vcan0"), ("--nonsense",),
                          ("--config", self.good, "--can", "vcan0", "--duration", "long")):
            status, out, err = run(*arguments)
            self.assertEqual((status, out), (1, ""))
            self.assertTrue(err)
        self.assertEqual(run("--help")[0], 0)

    def test_missing_privileges_are_named_and_the_flag_runs_on(self):
        arguments = ("--config", self.good, "--can", "vcan0", "--duration", "0.2")
        status, out, err = run(*arguments, program=self.for_nobody, before=become_nobody)
        self.assertEqual((status, out), (4, ""), err)
        for word in ("SCHED_FIFO", "CAP_SYS_NICE", "mlockall", "CAP_IPC_LOCK", "--allow-soft-realtime"):
            self.assertIn(word, err)
        self.assertEqual(err.count("\n"), 3, err)
        status, out, err = run(*arguments, "--allow-soft-realtime", program=self.for_nobody, before=become_nobody)
        self.assertEqual((status, out), (0, "wheelwrightd: running on vcan0\n"), err)
        self.assertIn("CAP_SYS_NICE", err)
        self.assertIn("CAP_IPC_LOCK", err)

    def test_with_the_privileges_it_starts_without_a_word_and_is_real_time(self):
        if not rig.may_be_realtime():
            self.skipTest("this user may not be real-time")
        process = subprocess.Popen([rig.wheelwrightd(), "--config", self.good, "--can", "vcan0", "--statistics"],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            self.assertEqual(process.stdout.readline(), "wheelwrightd: running on vcan0\n")
            self.assertEqual(os.sched_getscheduler(process.pid), os.SCHED_FIFO)
            self.assertEqual(os.sched_getparam(process.pid).sched_priority, 80)
            with open(f"/proc/{process.pid}/status", encoding="ascii") as file:
                locked = next(int(line.split()[1]) for line in file if line.startswith("VmLck"))
            self.assertGreater(locked, 1000)  # kB
        finally:
            started = time.monotonic()
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=rig.LONG)
        self.assertEqual((process.returncode, err), (0, ""))
        self.assertRegex(out, r"cycles \d+, missed \d+\n")
        print(f"ended {time.monotonic() - started:.2f} s after SIGINT, without drives; "
              + " | ".join(" ".join(line.split()) for line in out.splitlines()[:4]))


if __name__ == "__main__":
    rig.main()
