"""A machine seen from outside, while it runs with --sockets (toolchain/qemu/run-rt, toolchain/image/run), and what it left."""
import json
import os
import re
import socket
import struct
import subprocess
import tempfile
import threading

STOP, ENABLE = 1, 2  # lines of the PL061
LINES = f"""
[lines]
chip = "/dev/gpiochip0"
emergency_stop = {STOP}
drive_enable = {ENABLE}
"""
TORQUES = (0x02E, 0x04E)  # Set_Input_Torque of nodes 1 and 2
FRAME = re.compile(r"\((\d+\.\d+)\) \S+ ([0-9A-F]{3})#([0-9A-F]*)")


class Outside:
    """The far ends of the PL061's wires."""

    def __init__(self, folder):
        self.qmp = qmp = self.connect(folder, "qmp")
        qmp.readline()
        for command in ({"execute": "qmp_capabilities"},
                        {"execute": "qom-list", "arguments": {"path": "/machine/unattached"}}):
            qmp.write(json.dumps(command) + "\n")
            qmp.flush()
            answer = json.loads(qmp.readline())
        chip = next(child["name"] for child in answer["return"] if child["type"] == "child<pl061>")
        self.chip = f"/machine/unattached/{chip}"
        self.qtest = self.connect(folder, "qtest")
        self.seen = []  # what the machine drives: (line, level)
        threading.Thread(target=self.listen, daemon=True).start()
        self.say(f"irq_intercept_out {self.chip}")

    @staticmethod
    def connect(folder, name):
        wire = socket.socket(socket.AF_UNIX)
        wire.connect(os.path.join(folder, name))
        return wire.makefile("rw", encoding="ascii")

    def listen(self):
        for answer in self.qtest:
            words = answer.split()
            if words[0] == "IRQ":
                self.seen.append((int(words[2]), int(words[1] == "raise")))

    def say(self, text):
        self.qtest.write(text + "\n")
        self.qtest.flush()

    def set(self, line, level):
        self.say(f"set_irq_in {self.chip} unnamed-gpio-in {line} {level}")

    def end(self):
        """Ends the machine, whether it runs or stands."""
        self.qmp.write(json.dumps({"execute": "quit"}) + "\n")
        self.qmp.flush()


class Debugger:
    """Lets a controller say what QEMU's never does, for it knows no errors on its bus: controller.s in the guest's driver. Meanwhile the
    machine stands, from wherever it was. It meets no breakpoint and takes no single step: at each of these QEMU 7.2, where time counts
    instructions, lets its clock jump to the next timer. GDB's remote protocol."""
    PSTATE = 33  # of aarch64
    KERNEL = 0x3C5  # exception level 1, all interrupts masked
    SILENCE_s = 60  # in real time

    def __init__(self, folder):
        self.wire = socket.socket(socket.AF_UNIX)
        self.wire.settimeout(self.SILENCE_s)
        self.wire.connect(os.path.join(folder, "gdb"))  # and the machine stands still
        self.heard = b""
        self.ask("qXfer:features:read:target.xml:0,fff")  # else it tells no single registers

    def packet(self, after):
        while not (whole := re.search(rb"\$([^#]*)#..", self.heard)):
            try:
                part = self.wire.recv(4096)
            except TimeoutError:
                raise TimeoutError(f"the debugger's wire: nothing for {self.SILENCE_s} s after {after!r}") from None
            if not part:
                raise EOFError(f"the debugger's wire is cut after {after!r}")
            self.heard += part
        self.heard = self.heard[whole.end():]
        self.wire.sendall(b"+")
        return whole[1].decode()

    def ask(self, text):
        """The answer. That the machine stands ("T..") is told unasked, once the wire is taken."""
        self.wire.sendall(f"${text}#{sum(text.encode()) & 255:02x}".encode())
        while (answer := self.packet(text)).startswith("T"):
            pass
        return answer

    def must(self, text):
        if (answer := self.ask(text)) != "OK":
            raise RuntimeError(f"the debugger says {answer!r} to {text[:40]!r}")

    def write(self, address, content):
        self.must(f"M{address:x},{len(content):x}:{content.hex()}")

    def patch(self, at, entry, code, armed):
        """`code` lies `at`, and is where the function `entry` begins: the first word there is a nop, the tracer's. `armed` becomes 1."""
        # It may stand in a program, which is not allowed to see the kernel.
        pstate = self.ask(f"p{self.PSTATE:x}")
        self.must(f"P{self.PSTATE:x}={self.KERNEL.to_bytes(4, 'little').hex()}")
        jump = 0x14000000 | (at - entry >> 2 & 0x3FFFFFF)  # b at
        self.write(at, code)
        self.write(armed, b"\1")
        self.write(entry, jump.to_bytes(4, "little"))
        self.must(f"P{self.PSTATE:x}={pstate}")

    def leave(self):
        self.must("D")
        self.wire.close()


def controller_says(folder, room, room_end, **symbols):
    """At the next interrupt of a controller: what controller.s needs, and where nobody needs the guest's code any more."""
    with tempfile.TemporaryDirectory() as work:
        objects, binary = os.path.join(work, "o"), os.path.join(work, "bin")
        subprocess.run(["aarch64-linux-gnu-as", *(f"--defsym={name}={value:#x}" for name, value in symbols.items()), "-o", objects,
                        os.path.join(os.path.dirname(os.path.abspath(__file__)), "controller.s")], check=True)
        subprocess.run(["aarch64-linux-gnu-objcopy", "-O", "binary", objects, binary], check=True)
        with open(binary, "rb") as file:
            code = file.read()
    if len(code) > room_end - room:
        raise RuntimeError(f"no room for {len(code)} bytes from {room:#x} to {room_end:#x}")
    debugger = Debugger(folder)
    debugger.patch(room, symbols["read"], code, symbols["armed"])
    debugger.leave()


def changes(path):
    """What watch_lines saw: (last look before, first look after, levels)."""
    with open(path, encoding="ascii") as file:
        return [(float(before), float(after), int(levels, 16)) for before, after, levels in map(str.split, file)]


def edges(seen, line, level):
    """When the line took this level: (not before, not after)."""
    bit = 1 << line
    return [(before, after) for (before, after, levels), (_, _, last) in zip(seen[1:], seen)
            if levels & bit != last & bit and bool(levels & bit) == bool(level)]


def set_points(path):
    """Of both drives, from a log: (time, identifier, Nm)."""
    with open(path, encoding="ascii") as file:
        return [(float(m[1]), int(m[2], 16), struct.unpack("<f", bytes.fromhex(m[3][:8]))[0])
                for m in map(FRAME.match, file) if m and int(m[2], 16) in TORQUES]
