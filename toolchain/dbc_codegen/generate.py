#!/usr/bin/python3
"""Writes a C++ header with one struct per message of a DBC file.

    generate.py FILE.dbc HEADER.hpp --namespace NS [--id-name NAME]

canmatrix parses the DBC; this program checks what the generated code relies on and writes the header. What the
structs look like and what their members mean is said in firmware/protocol/codec.hpp.

How a signal becomes a field (first rule that fits):
    SIG_VALTYPE_ 1                float
    value table                   enum class, named after the VAL_TABLE_ with the same content;
                                  with BA_ "ValueKind" Open, numbers outside the table are legal;
                                  with Flags, an integer, and the table becomes constants <Name>::<flag>
    unit, or factor or offset     double, in the physical unit
    one bit                       bool
    otherwise                     the smallest integer type that holds it
The field's name is the signal's in snake_case plus the suffix of its unit from UNIT_SUFFIXES.

Limits, each an error when exceeded: classic frames (8 bytes), little endian, 32-bit floats, and multiplexed
messages whose branches all hold one signal of the same layout (they become one field, `value`; where their units
differ, it has none).
Exit status: 0 done, 1 usage, 2 the DBC cannot be used (each reason on stderr as file: message.signal: reason).
"""
import argparse
import contextlib
import decimal
import io
import os
import re
import sys

UNIT_SUFFIXES = {
    "": "",
    "%": "percent",
    "1/(kg m)": "per_kg_m",
    "1/(kg m2)": "per_kg_m2",
    "1/Nm2": "per_Nm2",
    "1/m": "per_m",
    "1/s": "per_s",
    "1/s2": "per_s2",
    "A": "A",
    "Nm": "Nm",
    "V": "V",
    "deg": "deg",
    "degC": "degC",
    "m": "m",
    "m/s": "m_per_s",
    "ms": "ms",
    "rad": "rad",
    "rad/s": "rad_per_s",
    "rev": "rev",
    "rev/s": "rev_per_s",
    "s": "s",
    "s4/(m2 rad2)": "s4_per_m2_rad2",
    "s4/rad4": "s4_per_rad4",
    "us": "us",
}
FLOAT_MAX = decimal.Decimal("3.4028234663852886e38")  # a range of +-this leaves only "finite" to check
CPP_WORDS = set(
    "alignas alignof and and_eq asm auto bitand bitor compl dynamic_cast not not_eq or or_eq xor xor_eq noexcept "
    "char8_t char16_t char32_t const_cast co_await co_return co_yield reinterpret_cast static_assert static_cast "
    "thread_local wchar_t auto bool break case catch char class concept const consteval constexpr constinit continue decltype default "
    "delete do double else enum explicit export extern false float for friend goto if inline int long mutable "
    "namespace new noexcept nullptr operator private protected public register requires return short signed sizeof "
    "static struct switch template this throw true try typedef typeid typename union unsigned using virtual void "
    "volatile while".split())


MEMBERS = {"id", "command", "name", "sender", "length", "extended", "cycle_time_ms", "sealed", "encode", "decode",
           "saturate", "for_each_field", "bits", "raw", "out", "bytes", "decoded", "changed", "self", "visit", "status"}


def snake_case(name):
    name = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name)
    return re.sub(r"_+", "_", re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1_\2", name)).lower()


def camel_case(name):
    return "".join(part[0].upper() + part[1:] for part in name.split("_") if part)


class Errors:
    def __init__(self, path):
        self.path = path
        self.lines = []

    def add(self, where, text):
        self.lines.append(f"{self.path}: {where}: {text}" if where else f"{self.path}: {text}")


def load(path, errors):
    """Parses the DBC. canmatrix reports trouble by printing and skips what it did not understand, so its output
    is captured, and every object of the file is counted again here."""
    noise = io.StringIO()
    with contextlib.redirect_stdout(noise), contextlib.redirect_stderr(noise):
        import canmatrix.formats
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            database = canmatrix.formats.loadp_flat(path)
    except Exception as reason:  # canmatrix raises whatever its regular expressions run into
        errors.add("", f"canmatrix cannot read this file: {reason!r}")
        return None
    for line in said.getvalue().splitlines():
        if line.strip():
            errors.add("", f"canmatrix: {line.strip()}")

    with open(path, encoding="ascii") as file:
        text = file.read()
    names = {frame.arbitration_id.to_compound_integer(): frame for frame in database.frames}
    ids = re.findall(r"^BO_ +(\d+) +(\w+)", text, re.M)
    if len(ids) != len(names):
        errors.add("", f"{len(ids)} BO_ lines, but {len(names)} messages with distinct ids were read")
    signals = len(re.findall(r"^ *SG_ ", text, re.M))
    if signals != sum(len(frame.signals) for frame in database.frames):
        errors.add("", f"{signals} SG_ lines, but another number of signals was read")
    references = re.findall(r"^(CM_ SG_|VAL_|SIG_VALTYPE_) +(\d+) +(\w+)", text, re.M)
    references += [("BA_ SG_", i, s) for i, s in re.findall(r'^BA_ +"\w+" +SG_ +(\d+) +(\w+)', text, re.M)]
    for what, number, signal in references:
        frame = names.get(int(number))
        if frame is None or frame.signal_by_name(signal) is None:
            errors.add(f"{number}.{signal}", f"{what} names a signal that does not exist")
    return database


def literal(number):
    """The shortest decimal that is this number as a double."""
    text = repr(float(number))
    return text if re.search(r"[.e]", text) else text + ".0"


class Field:
    """One field of a struct."""

    def __init__(self, signal, enums, errors, where, database):
        self.signal, self.where = signal, where
        self.start, self.size, self.signed = int(signal.start_bit), int(signal.size), bool(signal.is_signed)
        self.factor, self.offset = decimal.Decimal(signal.factor), decimal.Decimal(signal.offset)
        self.minimum = decimal.Decimal(signal.min) if signal.min is not None else None
        self.maximum = decimal.Decimal(signal.max) if signal.max is not None else None
        self.unit = signal.unit or ""
        self.value_kind = signal.attribute("ValueKind", database) or "Closed"
        self.enum = None
        if self.unit not in UNIT_SUFFIXES:
            errors.add(where, f'unit "{self.unit}" is not in UNIT_SUFFIXES of the generator')
        self.name = "_".join(filter(None, [snake_case(signal.name), UNIT_SUFFIXES.get(self.unit, "")]))
        if self.name in CPP_WORDS | MEMBERS:
            errors.add(where, f'"{self.name}" is a reserved word')
        if not signal.is_little_endian:
            errors.add(where, "big endian signals are not supported")
        if self.minimum is None or self.maximum is None or self.minimum >= self.maximum:
            errors.add(where, "the range [minimum|maximum] is missing or empty")
            self.minimum, self.maximum = decimal.Decimal(0), decimal.Decimal(1)

        if signal.is_float:
            self.kind = "float"
            if self.size != 32 or self.factor != 1 or self.offset != 0:
                errors.add(where, "a float must have 32 bits, factor 1 and offset 0")
        elif signal.values:
            self.kind = "flags" if self.value_kind == "Flags" else "enum"
            self.enum = next((n for n, table in enums.items() if table == signal.values), None)
            if self.enum is None:
                errors.add(where, "its VAL_ has no VAL_TABLE_ of the same content, which would name the type")
            if self.factor != 1 or self.offset != 0 or self.unit:
                errors.add(where, "a signal with a value table must have factor 1, offset 0 and no unit")
            if self.signed or max(signal.values, default=0) >= 1 << self.size:
                errors.add(where, "a signal with a value table must be unsigned and wide enough for it")
        elif self.unit or self.factor != 1 or self.offset != 0:
            self.kind = "scaled"
        else:
            self.kind = "bool" if self.size == 1 and not self.signed else "integer"

        if self.kind != "float":
            low, high = (self.minimum - self.offset) / self.factor, (self.maximum - self.offset) / self.factor
            self.low, self.high = int(low), int(high)
            lowest = -(1 << (self.size - 1)) if self.signed else 0
            highest = (1 << (self.size - 1 if self.signed else self.size)) - 1
            if low != self.low or high != self.high:
                errors.add(where, "the range does not end on multiples of the factor")
            if self.low < lowest or self.high > highest:
                errors.add(where, f"the range needs raw values {self.low}..{self.high}; "
                                  f"{self.size} bits hold {lowest}..{highest}")
            self.whole_range = (self.low, self.high) == (lowest, highest)
            if self.kind == "scaled" and not self.low <= 0 <= self.high:
                errors.add(where, "the raw value 0 lies outside its range")
        if self.kind == "enum":
            legal = [v for v in signal.values if self.low <= v <= self.high]
            self.default = min(legal, default=0)
            if not legal:
                errors.add(where, "no value of its table lies in its range")
        elif self.kind != "float" and not self.minimum <= 0 <= self.maximum:
            errors.add(where, "0, the value of a new message, lies outside its range")

    @property
    def width(self):
        return next(w for w in (8, 16, 32, 64) if self.size <= w)

    @property
    def integer_type(self):
        return f"std::{'' if self.signed else 'u'}int{self.width}_t"

    @property
    def type(self):
        return {"float": "float", "enum": self.enum, "scaled": "double", "bool": "bool"}.get(
            self.kind, self.integer_type)

    @property
    def step(self):
        return 0 if self.kind == "float" else self.factor

    def declaration(self):
        if self.kind == "enum":
            return f"{self.type} {self.name} = {self.enum}::{self.signal.values[self.default]};"
        return f"{self.type} {self.name}{{}};"

    def constants(self):
        if self.kind == "scaled" or (self.kind == "float" and not self.any_finite()):
            suffix = "F" if self.kind == "float" else ""
            yield f"static constexpr {self.type} {self.name}_min = {literal(self.minimum)}{suffix};"
            yield f"static constexpr {self.type} {self.name}_max = {literal(self.maximum)}{suffix};"
        elif self.kind == "integer" and not self.whole_range:
            yield f"static constexpr {self.integer_type} {self.name}_min = {self.low};"
            yield f"static constexpr {self.integer_type} {self.name}_max = {self.high}{'' if self.signed else 'U'};"
        if self.kind == "scaled":
            yield f"static constexpr double {self.name}_step = {literal(self.factor)};"

    def any_finite(self):
        return self.minimum <= -FLOAT_MAX and self.maximum >= FLOAT_MAX

    def range_check(self):
        """Refuses a raw value outside the range, unless the field's width or its value table already did."""
        if self.whole_range:
            return
        if self.kind == "enum" and self.value_kind == "Closed" and \
                all(self.low <= value <= self.high for value in self.signal.values):
            return
        tests = [f"raw < {self.low}"] if self.low > (-(1 << (self.size - 1)) if self.signed else 0) else []
        tests += [f"raw > {self.high}"] if self.high < (1 << (self.size - self.signed)) - 1 else []
        yield f"if ({' || '.join(tests)}) return CodecStatus::out_of_range;"

    def encode(self):
        place = f"place<{self.start}, {self.size}>"
        if self.kind == "float":
            check = f"check_float({self.name})" if self.any_finite() else \
                f"check_float({self.name}, {self.name}_min, {self.name}_max)"
            yield f"if (const auto status = {check}; status != CodecStatus::ok) return status;"
            yield f"bits |= {place}(std::bit_cast<std::uint32_t>({self.name}));"
        elif self.kind == "scaled":
            offset = f"{self.name} - {literal(self.offset)}" if self.offset else self.name
            yield f"if (const auto status = quantise({offset}, {self.name}_step, {self.low}, {self.high}, raw);"
            yield "    status != CodecStatus::ok) return status;"
            yield f"bits |= {place}(raw);"
        elif self.kind == "enum":
            yield f"raw = static_cast<std::int64_t>({self.name});"
            if self.value_kind == "Closed":
                yield f"if (!is_known({self.name})) return CodecStatus::unknown_value;"
            yield from self.range_check()
            yield f"bits |= {place}(raw);"
        elif self.kind == "bool":
            yield f"bits |= {place}({self.name} ? 1 : 0);"
        else:
            yield f"raw = static_cast<std::int64_t>({self.name});"
            yield from self.range_check()
            yield f"bits |= {place}(raw);"

    def decode(self):
        sign = "true" if self.signed else "false"
        extract = f"extract<{self.start}, {self.size}, {sign}>(bits)"
        if self.kind == "float":
            yield f"decoded.{self.name} = std::bit_cast<float>(static_cast<std::uint32_t>(bits >> {self.start}U));"
            check = f"check_float(decoded.{self.name})" if self.any_finite() else \
                f"check_float(decoded.{self.name}, {self.name}_min, {self.name}_max)"
            yield f"if (const auto status = {check}; status != CodecStatus::ok) return status;"
        elif self.kind == "bool":
            yield f"decoded.{self.name} = {extract} != 0;"
        elif self.kind == "enum":
            yield f"raw = {extract};"
            yield f"decoded.{self.name} = static_cast<{self.enum}>(raw);"
            if self.value_kind == "Closed":
                yield f"if (!is_known(decoded.{self.name})) return CodecStatus::unknown_value;"
            yield from self.range_check()
        else:
            yield f"raw = {extract};"
            yield from self.range_check()
            if self.kind == "scaled":
                offset = f" + {literal(self.offset)}" if self.offset else ""
                yield f"decoded.{self.name} = static_cast<double>(raw) * {self.name}_step{offset};"
            else:
                yield f"decoded.{self.name} = static_cast<{self.integer_type}>(raw);"

    def saturate(self):
        if self.kind == "scaled" or (self.kind == "float" and not self.any_finite()):
            yield f"changed |= saturate_value({self.name}, {self.name}_min, {self.name}_max);"

    def visit(self):
        low = literal(self.minimum)
        high = literal(self.maximum)
        yield (f'visit(FieldInfo{{"{self.name}", "{self.signal.name}", "{self.unit}", {low}, {high}, '
               f"{literal(self.step)}}}, self.{self.name});")


class Message:
    def __init__(self, frame, enums, errors, database):
        self.frame, self.name = frame, camel_case(frame.name)
        self.id, self.extended = frame.arbitration_id.id, bool(frame.arbitration_id.extended)
        self.length = int(frame.size)
        self.cycle_time_ms = int(frame.cycle_time)
        self.sender = frame.transmitters[0] if frame.transmitters else ""
        minimum = frame.attribute("MinimumLength", database)
        self.minimum_length = None if minimum is None or int(minimum) < 0 else int(minimum)
        if self.length > 8:
            errors.add(frame.name, "more than 8 bytes are not supported")
        if self.minimum_length is not None and self.minimum_length > self.length:
            errors.add(frame.name, "MinimumLength is larger than the length")

        used = {}
        for signal in frame.signals:
            for bit in range(int(signal.start_bit), int(signal.start_bit) + int(signal.size)):
                where = f"{frame.name}.{signal.name}"
                if bit >= 8 * self.length:
                    errors.add(where, f"bit {bit} lies behind the message's {self.length} bytes")
                    break
                for other in used.get(bit, []):
                    both = other.mux_val is not None and signal.mux_val is not None
                    if not (both and other.mux_val != signal.mux_val):
                        errors.add(where, f"shares bit {bit} with {other.name}")
                        break
                used.setdefault(bit, []).append(signal)

        branches = [s for s in frame.signals if s.mux_val is not None and not s.is_multiplexer]
        plain = [s for s in frame.signals if s not in branches]
        self.fields = [Field(s, enums, errors, f"{frame.name}.{s.name}", database) for s in plain]
        if branches:
            layouts = {(s.start_bit, s.size, s.is_signed, s.factor, s.offset, s.min, s.max, s.is_float) for s in branches}
            selectors = [s.mux_val for s in branches]
            selector = next((f for f in self.fields if f.signal.is_multiplexer), None)
            if len(layouts) != 1 or len(set(selectors)) != len(selectors):
                errors.add(frame.name, "multiplexed branches must hold one signal each, all of the same layout")
            if selector is None or set(selector.signal.values) != set(selectors):
                errors.add(frame.name, "the multiplexor needs a value table that names each branch and no other")
            value = Field(branches[0], enums, errors, f"{frame.name}.{branches[0].name}", database)
            if any((s.unit or "") != value.unit for s in branches):
                value.unit = ""
            value.name = "_".join(filter(None, ["value", UNIT_SUFFIXES.get(value.unit, "")]))
            self.fields.append(value)
        names = [f.name for f in self.fields]
        for name in sorted({n for n in names if names.count(n) > 1}):
            errors.add(frame.name, f"two signals would both be called {name}")
        self.sealed = {"crc", "alive"} <= set(names)
        if self.sealed:
            place = {f.name: (f.start, f.size) for f in self.fields}
            if place["crc"] != (0, 8) or place["alive"] != (8, 4):
                errors.add(frame.name, "Crc must be byte 0 and Alive the low nibble of byte 1")

    def emit(self, id_name):
        yield from comment(self.frame.comment)
        yield f"struct {self.name} {{"
        yield f'    static constexpr std::string_view name = "{self.frame.name}";'
        yield f'    static constexpr std::string_view sender = "{self.sender}";'
        yield f"    static constexpr std::uint32_t {id_name} = 0x{self.id:03X};"
        yield f"    static constexpr std::uint8_t length = {self.length};"
        yield f"    static constexpr bool extended = {str(self.extended).lower()};"
        yield f"    static constexpr std::uint16_t cycle_time_ms = {self.cycle_time_ms};"
        yield f"    static constexpr bool sealed = {str(self.sealed).lower()};"
        for field in self.fields:
            yield ""
            for line in comment(field.signal.comment if field.signal.mux_val is None else "What the multiplexor names."):
                yield "    " + line
            yield "    " + field.declaration()
            for line in field.constants():
                yield "    " + line
        empty = not self.fields
        raw = any(f.kind not in ("float", "bool") for f in self.fields)
        yield ""
        unused = "[[maybe_unused]] " if empty else ""
        yield f"    [[nodiscard]] constexpr CodecStatus encode({unused}std::span<std::uint8_t> out) const {{"
        if empty:
            yield "        return CodecStatus::ok;"
        else:
            yield "        if (out.size() < length) return CodecStatus::wrong_length;"
            yield "        std::uint64_t bits = 0;"
            if any(f.kind in ("scaled", "enum", "integer", "flags") for f in self.fields):
                yield "        std::int64_t raw = 0;"
            for field in self.fields:
                for line in field.encode():
                    yield "        " + line
            yield "        store<length>(bits, out);"
            yield "        return CodecStatus::ok;"
        yield "    }"
        yield ""
        unused = "[[maybe_unused]] " if empty and self.minimum_length == 0 else ""
        yield f"    [[nodiscard]] static constexpr CodecStatus decode({unused}std::span<const std::uint8_t> bytes, {self.name}& out) {{"
        if self.minimum_length is None:
            yield "        if (bytes.size() != length) return CodecStatus::wrong_length;"
        elif self.minimum_length > 0:
            yield f"        if (bytes.size() < {self.minimum_length}) return CodecStatus::wrong_length;"
        if not empty:
            loader = "load<length>" if self.minimum_length in (None, self.length) else "load_short<length>"
            yield f"        const std::uint64_t bits = {loader}(bytes);"
            if raw:
                yield "        std::int64_t raw = 0;"
        yield f"        {self.name} decoded;"
        for field in self.fields:
            for line in field.decode():
                yield "        " + line
        yield "        out = decoded;"
        yield "        return CodecStatus::ok;"
        yield "    }"
        saturated = [line for field in self.fields for line in field.saturate()]
        if saturated:
            yield ""
            yield "    constexpr bool saturate() {"
            yield "        bool changed = false;"
            for line in saturated:
                yield "        " + line
            yield "        return changed;"
            yield "    }"
        yield ""
        unused = "[[maybe_unused]] " if empty else ""
        yield "    template <typename Self, typename Visitor>"
        yield f"    static constexpr void for_each_field({unused}Self& self, {unused}Visitor&& visit) {{"
        for field in self.fields:
            for line in field.visit():
                yield "        " + line
        yield "    }"
        yield "};"


def comment(text):
    words, line = (text or "").split(), "//"
    for word in words:
        if len(line) + 1 + len(word) > 106:
            yield line
            line = "//"
        line += " " + word
    if words:
        yield line


def emit_enum(name, table, width, flags):
    values = sorted(table.items())
    base = f"std::uint{width}_t"
    if flags:
        yield f"// Single bits of the integer fields that carry {name}."
        yield f"struct {name} {{"
        for value, label in values:
            yield f"    static constexpr {base} {label} = 0x{value:X}U;"
        yield "};"
        return
    yield f"enum class {name} : {base} {{"
    for value, label in values:
        yield f"    {label} = {value},"
    yield "};"
    yield f"inline constexpr std::array<{name}, {len(values)}> {snake_case(name)}_values{{"
    for _, label in values:
        yield f"    {name}::{label},"
    yield "};"
    yield f"constexpr bool is_known({name} value) {{"
    if [v for v, _ in values] == list(range(len(values))):
        yield f"    return static_cast<{base}>(value) <= {values[-1][0]};"
    else:
        yield "    switch (value) {"
        for _, label in values:
            yield f"        case {name}::{label}:"
        yield "            return true;"
        yield "    }"
        yield "    return false;"
    yield "}"
    yield f"constexpr std::string_view to_string_view({name} value) {{"
    yield "    switch (value) {"
    for _, label in values:
        yield f"        case {name}::{label}:"
        yield f'            return "{label}";'
    yield "    }"
    yield '    return "unknown";'
    yield "}"


def generate(path, namespace, id_name, errors):
    database = load(path, errors)
    if database is None:
        return ""
    enums = {name: {int(k): v for k, v in table.items()} for name, table in database.value_tables.items()}
    for name, table in enums.items():
        twins = [n for n, t in enums.items() if t == table and n < name]
        if twins:
            errors.add(name, f"value table with the same content as {twins[0]}")
        for label in table.values():
            if not re.fullmatch(r"[a-z][a-z0-9_]*", label) or label in CPP_WORDS:
                errors.add(name, f'"{label}" cannot be the name of a value: use lower-case words joined by _')
    messages = [Message(frame, enums, errors, database) for frame in database.frames]
    names = [m.name for m in messages] + list(enums)
    for name in sorted({n for n in names if names.count(n) > 1}):
        errors.add(name, "two messages or value tables have this name")
    flags = {f.enum for m in messages for f in m.fields if f.kind == "flags"}
    if errors.lines:
        return ""

    source = os.path.basename(path)
    out = [f"// Generated from {source} by toolchain/dbc_codegen/generate.py: change those, not this.",
           "// What the members mean, costs and errors: firmware/protocol/codec.hpp.",
           "#pragma once", "",
           "#include <array>", "#include <bit>", "#include <cstdint>", "#include <span>", "#include <string_view>", "",
           '#include "firmware/protocol/codec.hpp"', "",
           f"namespace {namespace} {{", "",
           "// clang-format off"]
    if namespace != "wheelwright::protocol":
        for name in ("CodecStatus", "FieldInfo", "MessageInfo", "MessageList"):
            out.append(f"using wheelwright::protocol::{name};")
    for name in ("check_float", "extract", "load", "load_short", "place", "quantise", "saturate_value", "store"):
        out.append(f"using wheelwright::protocol::codec::{name};")
    for name, table in enums.items():
        width = max((f.width for m in messages for f in m.fields if f.enum == name), default=8)
        out.append("")
        out.extend(emit_enum(name, table, width, name in flags))
    for message in messages:
        out.append("")
        out.extend(message.emit(id_name))
    out += ["", "// All messages, in the order of the DBC."]
    out.append("using AllMessages = MessageList<" + ", ".join(m.name for m in messages) + ">;")
    out.append(f"inline constexpr std::array<MessageInfo, {len(messages)}> all_messages{{{{")
    for m in messages:
        out.append(f"    {{0x{m.id:03X}, {m.length}, {str(m.extended).lower()}, {m.cycle_time_ms}, "
                   f'{str(m.sealed).lower()}, "{m.frame.name}", "{m.sender}"}},')
    out += ["}};", "// clang-format on", "", f"}}  // namespace {namespace}", ""]
    return "\n".join(out)


def main():
    parser = argparse.ArgumentParser(description="Writes a C++ header with one struct per message of a DBC file.")
    parser.add_argument("dbc")
    parser.add_argument("header")
    parser.add_argument("--namespace", required=True)
    parser.add_argument("--id-name", default="id", help="name of the constant that holds the message's id")
    arguments = parser.parse_args()
    errors = Errors(arguments.dbc)
    text = generate(arguments.dbc, arguments.namespace, arguments.id_name, errors)
    if errors.lines:
        print("\n".join(errors.lines), file=sys.stderr)
        return 2
    os.makedirs(os.path.dirname(arguments.header) or ".", exist_ok=True)
    with open(arguments.header, "w", encoding="ascii") as file:
        file.write(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
