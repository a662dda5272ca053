#!/usr/bin/python3
"""Compares the generated codec with canmatrix, frame by frame.

    compare_with_canmatrix.py FRAMES_PROGRAM SEED COUNT FILE.dbc...

FRAMES_PROGRAM (frames.cpp) prints random frames with what the generated code made of them. For each, canmatrix
encodes the same values, decodes the same bytes, and this script judges from the DBC alone whether and why a frame
must be refused. Exit status 1 when anything differs.
"""
import collections
import contextlib
import decimal
import io
import math
import os
import subprocess
import sys

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    import canmatrix.formats

Decimal = decimal.Decimal


def load(path):
    """The DBC as canmatrix reads it; anything it says about it is an error."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        database = canmatrix.formats.loadp_flat(path)
    if said.getvalue():
        sys.exit(f"{path}: canmatrix says: {said.getvalue()}")
    return database


def nearest(signal, value):
    """The physical value the frame must hold for `value`: the nearest multiple of the factor."""
    if signal.is_float:
        return Decimal(value)
    raw = ((Decimal(value) - signal.offset) / signal.factor).quantize(Decimal(1), decimal.ROUND_HALF_UP)
    return raw * signal.factor + signal.offset


def why_refused(frame, database, values, length):
    """Status the decoder must return, by the DBC; `values` are canmatrix's, in the DBC's order."""
    minimum = int(frame.attribute("MinimumLength", database))
    if (minimum < 0 and length != frame.size) or length < minimum:
        return "wrong_length"
    for signal, value in values:
        if not math.isfinite(value):
            return "not_finite"
        closed = signal.attribute("ValueKind", database) == "Closed"
        if signal.values and closed and int(value) not in signal.values:
            return "unknown_value"
        if not signal.min <= Decimal(value) <= signal.max:
            return "out_of_range"
    return "ok"


def canmatrix_values(frame, data):
    """(signal, value) in the order of the C++ fields: plain signals, then the multiplexed one of this frame."""
    padded = (data + bytes(8))[:frame.size]
    decoded = frame.decode(padded) if frame.size else {}
    plain = [s for s in frame.signals if s.name in decoded and s.mux_val is None]
    branch = [s for s in frame.signals if s.name in decoded and s.mux_val is not None]
    return [(s, decoded[s.name].phys_value) for s in plain + branch]


def field_values(fields, signals):
    for field, signal in zip(fields, signals):
        name, value = field.split("=")
        number, _, label = value.partition(":")
        if signal.mux_val is None:
            assert name == signal.name, f"{name} where {signal.name} should be"
        if label and label != signal.values.get(int(number), "unknown"):
            raise AssertionError(f"{name}: {number} is called {label}")
        yield signal, float(number)


def check(database, name, what, data, rest):
    frame = database.frame_by_name(name)
    values = canmatrix_values(frame, data)
    signals = [signal for signal, _ in values]
    if what == "encode":
        fields = list(field_values(rest, signals))
        assert len(fields) == len(rest), "not all fields are signals, or the multiplexor chose no branch"
        raw = {s.name: s.phys2raw(nearest(s, v)) for s, v in fields}
        theirs = bytes(frame.encode(raw)) if frame.size else b""
        assert theirs == data, f"canmatrix encodes {theirs.hex()}"
        return "encoded"
    expected = why_refused(frame, database, values, len(data))
    assert rest[0] == expected, f"status {rest[0]}, the DBC says {expected}"
    if expected == "ok":
        assert len(rest) - 1 == len(values), "number of fields"
        for (signal, theirs), (_, ours) in zip(values, field_values(rest[1:], signals)):
            same = ours == float(theirs) if signal.is_float else math.isclose(ours, float(theirs), rel_tol=4e-16)
            assert same, f"{signal.name} is {ours}, canmatrix decodes {theirs}"
    return expected


def main():
    program, seed, count, *paths = sys.argv[1:]
    databases = {os.path.basename(path).removesuffix(".dbc"): load(path) for path in paths}
    run = subprocess.run([program, seed, count], stdout=subprocess.PIPE, text=True, check=False)
    if run.returncode:
        print(f"{program} {seed} {count} returned {run.returncode}")
        return 1
    results, seen, failures = collections.Counter(), set(), 0
    for line in run.stdout.splitlines():
        dbc, name, what, hexadecimal, *rest = line.split()
        seen.add((dbc, name))
        try:
            results[check(databases[dbc], name, what, bytes.fromhex(hexadecimal.replace("-", "")), rest)] += 1
        except AssertionError as reason:
            failures += 1
            if failures <= 10:
                print(f"{line}\n    {reason}")
    wanted = {(dbc, frame.name) for dbc, database in databases.items() for frame in database.frames}
    if seen != wanted:
        print("messages without a frame:", sorted(wanted - seen))
        return 1
    missing = {"encoded", "ok", "wrong_length", "not_finite", "out_of_range", "unknown_value"} - set(results)
    if missing:
        print("no frame came to:", sorted(missing))
        return 1
    print(f"{sum(results.values())} frames of {len(seen)} messages agree, {failures} differ:", dict(results))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
