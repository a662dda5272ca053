#!/usr/bin/python3
"""Plants one mistake at a time in a copy of the DBC and expects the generator to name file, signal and reason.

    generator_refuses.py GENERATOR FILE.dbc
"""
import os
import subprocess
import sys
import tempfile

# (text in the DBC, what replaces it, what the generator must say)
MISTAKES = [
    ('(0.001,0) [-32.767|32.767] "Nm" Firmware', '(0.001,0) [-32.767|32.767] "Nmm" Firmware',
     'TorqueCommand.LeftTorque: unit "Nmm" is not in UNIT_SUFFIXES'),
    ("SG_ LeftTorque : 16|16@1-", "SG_ LeftTorque : 16|17@1-", "TorqueCommand.RightTorque: shares bit 32"),
    ("SG_ RightTorque : 32|16@1-", "SG_ RightTorque : 33|16@1-", "TorqueCommand.RightTorque: bit 48 lies behind"),
    ("SG_ LeftTorque : 16|16@1-", "SG_ LeftTorque : 23|16@0-", "TorqueCommand.LeftTorque: big endian"),
    ("SG_ LeftTorque : 16|16@1-", "SG_ LeftTorque : 16|15@1-", "TorqueCommand.LeftTorque: the range needs raw values"),
    ("[-32.767|32.767]", "[-32.7675|32.767]", "TorqueCommand.LeftTorque: the range does not end on multiples"),
    ("[-32.767|32.767]", "[0|0]", "TorqueCommand.LeftTorque: the range [minimum|maximum] is missing"),
    ("[-32.767|32.767]", "[1|32.767]", "TorqueCommand.LeftTorque: 0, the value of a new message"),
    ("SG_ LeftTorque : 16|16@1-", "SG_ LeftTorque : 16,16@1-", "signals was read"),
    ("SG_ LeftTorque", "SG_ FrontTorque", "1538.LeftTorque: CM_ SG_ names a signal that does not exist"),
    ("BO_ 1538 TorqueCommand", "BO_ 1539 TorqueCommand", "messages with distinct ids"),
    ("BO_ 1538 TorqueCommand: 6", "BO_ 1538 TorqueCommand: 12", "TorqueCommand: more than 8 bytes"),
    ("BO_ 1538 TorqueCommand", "BO_ 1538 Mode", "Mode: two messages or value tables have this name"),
    ("SG_ Crc : 0|8@1+", "SG_ Crc : 12|4@1+", "ModeCommand"),
    ('VAL_ 1537 Mode 0 "boot"', 'VAL_ 1537 Mode 0 "start"', "ModeCommand.Mode: its VAL_ has no VAL_TABLE_"),
    ('VAL_TABLE_ Fault 0 "none"', 'VAL_TABLE_ Fault 0 "default"', '"default" cannot be the name of a value'),
    ("SIG_VALTYPE_ 1546 Value", "SIG_VALTYPE_ 1546 Valve", "1546.Valve: SIG_VALTYPE_ names a signal that does not"),
    ("CM_ SG_ 1546 Value", "CM_ SG_ 1547 Value", "1547.Value: CM_ SG_ names a signal that does not exist"),
    ("m3 : 8|32@1+", "m3 : 8|24@1+", "Counters"),
    ("m3 : 8|32@1+", "m2 : 8|32@1+", "Counters"),
]


def main():
    generator, path = sys.argv[1:]
    with open(path, encoding="ascii") as file:
        text = file.read()
    failures = 0
    with tempfile.TemporaryDirectory() as folder:
        copy, header = os.path.join(folder, "copy.dbc"), os.path.join(folder, "copy.hpp")
        for number, (old, new, expected) in enumerate([("VERSION", "VERSION", "")] + MISTAKES):
            assert old in text, f"{old} is not in the DBC any more"
            with open(copy, "w", encoding="ascii") as file:
                file.write(text.replace(old, new, 1))
            run = subprocess.run([sys.executable, generator, copy, header, "--namespace", "copy"], text=True, check=False,
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            written = os.path.exists(header)
            if number == 0:
                good = run.returncode == 0 and written and not run.stdout
                os.remove(header)
            else:
                lines = run.stdout.splitlines()
                good = run.returncode == 2 and not written and any(expected in line for line in lines) and \
                    all(line.startswith(copy) for line in lines)
            if not good:
                failures += 1
                print(f"{old} -> {new}: returned {run.returncode}, header {written}, said:\n{run.stdout}")
    print(f"{len(MISTAKES)} mistakes, {failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
