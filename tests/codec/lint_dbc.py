#!/usr/bin/python3
"""Checks that a DBC can be worked from without further documents.

    lint_dbc.py FILE.dbc...

Each message and signal has a comment; each signal a range, and a unit unless it is on the list below (a multiplexed one
may have one, for its branches share one field); cyclic
messages have a cycle time and others have none; ids are unique and no signals overlap; each value table is used.
"""
import contextlib
import io
import sys

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    import canmatrix.formats

# Signals without a unit on purpose: numbers, counts, bit fields, ratios, and values whose unit is the parameter's.
UNITLESS = set("""
    Crc Alive Index Value Generation Error Samples MissedCycles TelemetryDeferred ReceiveOverflow SendRefused SensitivityPeak
    Protocol_Version Hw_Version_Major Hw_Version_Minor Hw_Version_Variant
    Fw_Version_Major Fw_Version_Minor Fw_Version_Revision Fw_Version_Unreleased
    Procedure_Result Motor_Error CodeLow CodeHigh NonceLow NonceHigh
    Endpoint_ID Reserved Reserved0 Reserved1 Identify Count
""".split())


def lint(path):
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        database = canmatrix.formats.loadp_flat(path)
    if said.getvalue():
        yield f"canmatrix says: {said.getvalue()}"
    ids = [frame.arbitration_id.id for frame in database.frames]
    if len(ids) != len(set(ids)):
        yield "two messages have the same id"
    used = []
    for frame in database.frames:
        if not frame.comment:
            yield f"{frame.name}: no comment"
        if frame.transmitters[0] not in [ecu.name for ecu in database.ecus]:
            yield f"{frame.name}: its sender is not a node"
        if (frame.attribute("GenMsgSendType", database) == "Cyclic") != (frame.cycle_time > 0):
            yield f"{frame.name}: a cyclic message needs a cycle time, another must not have one"
        taken = {}
        for signal in frame.signals:
            name = f"{frame.name}.{signal.name}"
            used.append(signal.values)
            if not signal.comment:
                yield f"{name}: no comment"
            if signal.min is None or signal.max is None or signal.min >= signal.max:
                yield f"{name}: no range"
            plain = signal.values or signal.size == 1 or signal.name in UNITLESS
            if signal.mux_val is None and bool(signal.unit) == bool(plain):
                yield f"{name}: unit '{signal.unit}' (list it as unit-less if it has none on purpose)"
            for bit in range(signal.start_bit, signal.start_bit + signal.size):
                for other in taken.setdefault(bit, []):
                    if None in (other.mux_val, signal.mux_val) or other.mux_val == signal.mux_val:
                        yield f"{name}: overlaps {other.name} at bit {bit}"
                taken[bit].append(signal)
            if signal.start_bit + signal.size > 8 * frame.size:
                yield f"{name}: lies outside the frame"
    for name, table in database.value_tables.items():
        if {int(number): label for number, label in table.items()} not in used:
            yield f"value table {name} is not used"


def main():
    found = [f"{path}: {text}" for path in sys.argv[1:] for text in lint(path)]
    print("\n".join(found) or "no findings")
    return 1 if found or len(sys.argv) < 2 else 0


if __name__ == "__main__":
    sys.exit(main())
