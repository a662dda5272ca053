"""A machine seen from outside, while it runs with --sockets (toolchain/qemu/run-rt, toolchain/image/run), and what it left."""
import json
import os
import re
import socket
import struct
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
        qmp = self.connect(folder, "qmp")
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


class Debugger:
    """Lets a controller say what QEMU's never does, for it knows no errors on its bus. The driver runs as it is; twice, when it asks the
    controller's registers, it is answered otherwise. GDB's remote protocol."""
    INTERRUPT, STATUS = 3, 2  # registers of an SJA1000
    PC = 32  # of aarch64; 0..30 are x0..x30

    def __init__(self, folder):
        self.wire = socket.socket(socket.AF_UNIX)
        self.wire.connect(os.path.join(folder, "gdb"))  # and the machine stands still
        self.heard = b""
        self.ask("qXfer:features:read:target.xml:0,fff")  # else it tells no single registers

    def send(self, text):
        self.wire.sendall(f"${text}#{sum(text.encode()) & 255:02x}".encode())

    def packet(self):
        while not (whole := re.search(rb"\$([^#]*)#..", self.heard)):
            part = self.wire.recv(4096)
            if not part:
                raise EOFError("the debugger's wire is cut")
            self.heard += part
        self.heard = self.heard[whole.end():]
        self.wire.sendall(b"+")
        return whole[1].decode()

    def ask(self, text):
        """The answer. That the machine stands ("T..") is told unasked, once the wire is taken."""
        self.send(text)
        while (answer := self.packet()).startswith("T"):
            pass
        return answer

    def go(self, how):
        """On, and until it stands again."""
        self.send(how)
        while not self.packet().startswith("T"):
            pass

    def register(self, number):
        return int.from_bytes(bytes.fromhex(self.ask(f"p{number:x}")), "little")

    def until(self, address):
        """Runs until it gets there."""
        self.ask(f"Z1,{address:x},4")
        self.go("c")
        self.ask(f"z1,{address:x},4")

    def error(self, interface, handler, read, causes, status):
        """At its next interrupt (`handler`, of the driver) the interface's controller tells (`read`) these causes and this status."""
        while True:
            self.until(handler)
            device = bytes.fromhex(self.ask(f"m{self.register(1):x},10"))  # its name comes first
            if device.split(b"\0")[0].decode() == interface:
                break
            self.go("s")
        for which, value in ((self.INTERRUPT, causes), (self.STATUS, status)):
            while True:
                self.until(read)
                if self.register(1) == which:
                    break
                self.go("s")
            for number, content in ((0, value), (self.PC, self.register(30))):  # what is returned, and to where
                self.ask(f"P{number:x}={content.to_bytes(8, 'little').hex()}")

    def leave(self):
        self.ask("D")
        self.wire.close()


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
