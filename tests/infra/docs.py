#!/usr/bin/env python3
"""What the documents say is true of the repository: README.md and docs/*.md.

    docs.py ROOT PROGRAM      PROGRAM is the built `wheelwright`

Links lead somewhere, headings included. Programs, subcommands, options, scripts, presets and tests that are named
exist.
cansend lines decode by canmatrix, with the right length, CRC and values in range. Every mode, fault, blocker and
message of the DBC is spoken of in docs/driving.md, faults in the order of the table that the firmware runs, and every
cause of an identification's end, in the tools' words, in docs/identification.md. Then each kind of mistake is planted in a copy, and not finding one fails.
"""
import contextlib
import functools
import io
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

with contextlib.redirect_stderr(io.StringIO()):  # canmatrix complains about formats that nobody asked for
    import canmatrix.formats

DBC = "firmware/protocol/wheelwright.dbc"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)


def documents(root):
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


# ---- links ------------------------------------------------------------------------------------------------------


def anchors(text):
    """The anchors a forge makes of the headings."""
    for title in re.findall(r"^#+ +(.+?) *$", FENCE.sub("", text), re.M):
        yield re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def links(root, _program):
    for page in documents(root):
        text = FENCE.sub("", page.read_text(encoding="utf-8"))
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if re.match(r"https?://", target):
                continue
            path, _, anchor = target.partition("#")
            file = (page.parent / path).resolve() if path else page
            if not file.exists():
                yield f"{page.name}: link to {target}: there is no such file"
            elif anchor and anchor not in anchors(file.read_text(encoding="utf-8")):
                yield f"{page.name}: link to {target}: {file.name} has no such heading"


# ---- commands ---------------------------------------------------------------------------------------------------


@functools.cache
def help_of(*command):
    result = subprocess.run([*command, "--help"], capture_output=True, text=True, timeout=60, check=False)
    return result.stdout if result.returncode == 0 else None


def subcommands(text):
    return set(re.findall(r"^  ([a-z][\w-]*)", text.partition("\nSubcommands:\n")[2], re.M))


def told_commands(text):
    """What stands in code: lines of fenced blocks, and spans in back ticks."""
    for language, block in FENCE.findall(text):
        if language in ("", "sh", "bash"):
            yield from block.splitlines()
    for span in re.findall(r"`([^`\n]+)`", FENCE.sub("", text)):
        yield span


def command_problem(words, program):
    """`words` begins with wheelwright or wheelwrightd."""
    at = [program if words[0] == "wheelwright" else program + "d"]
    text = help_of(*at)
    known = text
    for word in words[1:]:
        if word in ("|", "&", "&&", ";", ">", "..."):
            break
        option = re.match(r"--[a-z][\w-]*", word)
        if option:
            if option[0] != "--help" and not re.search(rf"(?<![\w-]){option[0]}(?![\w-])", known):
                return f"no option {option[0]}"
        elif subcommands(text):
            if not re.fullmatch(r"[a-z][\w-]*", word):
                break  # a placeholder
            if word not in subcommands(text):
                return f"no subcommand {word}"
            at.append(word)
            text = help_of(*at)
            known += text
    return None


@functools.cache
def all_options(program):
    """Of both programs and every subcommand."""
    def helps(*command):
        text = help_of(*command)
        yield text
        for name in subcommands(text):
            yield from helps(*command, name)
    texts = [help_of(program + "d"), *helps(program)]
    return set(re.findall(r"--[a-z][\w-]*", " ".join(texts)))


def commands(root, program):
    presets = (root / "CMakePresets.json").read_text(encoding="utf-8")
    for page in documents(root):
        for line in told_commands(page.read_text(encoding="utf-8")):
            for found in re.finditer(r"(?:^|[\s/])(wheelwrightd?(?: [^#`]*)?$)", line.split(" # ")[0].strip()):
                for part in re.split(r" [|&;]+ ", found[1]):
                    words = part.split()
                    if words and words[0] in ("wheelwright", "wheelwrightd"):
                        problem = command_problem(words, program)
                        if problem:
                            yield f"{page.name}: `{part}`: {problem}"
            if line.startswith("--") and line.split()[0] not in all_options(program):
                yield f"{page.name}: `{line}`: no program has this option"
            for path in re.findall(r"(?:^|\s)(?:\./)?((?:tools|docs|tests|toolchain|firmware)/[\w./-]+)", line):
                if not (root / path).exists():
                    yield f"{page.name}: `{line.strip()}`: there is no {path}"
            for preset in re.findall(r"--preset ([\w-]+)", line):
                if f'"{preset}"' not in presets:
                    yield f"{page.name}: no preset {preset}"


# ---- tests ------------------------------------------------------------------------------------------------------


def registered_tests(root):
    """The names that the CMake files register."""
    for file in (root / "tests").rglob("CMakeLists.txt"):
        text = re.sub(r"#.*", "", file.read_text(encoding="utf-8"))
        for name, groups in re.findall(r"wheelwright_test\(\s*NAME (\w+)\s+GROUPS\s+((?:[A-Z]\w*[a-z]\w*\s+)+)", text):
            yield from (f"{name}.{group}" for group in groups.split())
        yield from re.findall(r"NAME ([\w.]+)", text)
        yield from (f"system.{name}" for name in re.findall(r"wheelwright_system_test\((\w+) \d", text))


def tests(root, _program):
    known = set(registered_tests(root))
    for page in documents(root):
        text = page.read_text(encoding="utf-8")
        named = re.findall(r"`(\w+\.\w+)`", text) if page.name == "measured.md" else []
        for name in named + re.findall(r"ctest .*-R ([\w.]+)", text):
            folder, _, rest = name.partition(".")
            if (root / "tests" / folder.split("_")[0]).is_dir() or rest[:1].isupper():
                if name not in known:
                    yield f"{page.name}: {name}: no such test"


# ---- frames -----------------------------------------------------------------------------------------------------


def crc8(data):
    """CRC-8 SAE J1850, from its definition."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def frame_problem(matrix, identifier, data):
    frame = matrix.frame_by_id(canmatrix.ArbitrationId(identifier, extended=False))
    if frame is None:
        return "no message has this identifier"
    if len(data) != frame.size:
        return f"{frame.name} has {frame.size} bytes"
    if frame.signal_by_name("Crc") and data[0] != crc8(data[1:]):
        return f"wrong CRC: {crc8(data[1:]):02X} would be right"
    for name, value in frame.decode(data).items() if data else ():
        signal = frame.signal_by_name(name)
        if not signal.min <= value.phys_value <= signal.max:
            return f"{name} is {value.phys_value}, outside {signal.min}..{signal.max}"
    return None


def frames(root, program):
    matrix = canmatrix.formats.loadp_flat(str(root / DBC))
    count = 0
    for page in documents(root):
        for where, identifier, data in re.findall(r"cansend (\w+) ([0-9A-F]{3})#([0-9A-F]*)(?![\w$])",
                                                  page.read_text(encoding="utf-8")):
            if data == "" and identifier != "600":
                continue  # a frame whose data a shell puts together
            count += 1
            problem = frame_problem(matrix, int(identifier, 16), bytes.fromhex(data))
            if problem:
                yield f"{page.name}: cansend {where} {identifier}#{data}: {problem}"
    if count < 5:
        yield f"only {count} cansend lines found: the search is broken"
    line = subprocess.run([program, "ctl", "mode", "velocity", "--print"], capture_output=True, text=True, check=True).stdout.strip()
    if line not in (root / "README.md").read_text(encoding="utf-8"):
        yield f"README.md switches the mode with another line than `ctl mode velocity --print` gives: {line}"


# ---- names ------------------------------------------------------------------------------------------------------


def value_table(dbc, name):
    return re.findall(r'"(\w+)"', re.search(rf"^VAL_TABLE_ {name} (.*);$", dbc, re.M)[1])


def names(root, _program):
    dbc = (root / DBC).read_text(encoding="utf-8")
    page = (root / "docs/driving.md").read_text(encoding="utf-8")
    for name in {*value_table(dbc, "Mode"), *value_table(dbc, "Fault"), *value_table(dbc, "Blocker")} - {"none"}:
        if not re.search(rf"\b{name}\b", page):
            yield f"driving.md does not speak of {name}"
    page_of_causes = (root / "docs/identification.md").read_text(encoding="utf-8")
    words = (root / "tools/cli/ident_words.cpp").read_text(encoding="utf-8")
    for name in {*value_table(dbc, "IdentCause")} - {"none"}:
        happened, change = (re.sub(r'\\(.)', r"\1", re.sub(r'"\s*"', "", text)) for text in re.search(
            rf'IdentCause::{name},\s*\{{"((?:\\.|"\s*"|[^"])*)",\s*"((?:\\.|"\s*"|[^"])*)"\}}', words).groups())
        if f"| {name} | {happened} | {change} |" not in page_of_causes:
            yield f"identification.md does not say of {name}: {happened} | {change}"
    for message in re.findall(r"^BO_ \d+ (\w+):", dbc, re.M):
        stem = re.sub(r"K\dK\d$", "", message)
        if not re.search(rf"\b{stem}\b", page):
            yield f"driving.md does not speak of {message}"
    rules = re.findall(r"FaultRule\{&Conditions::\w+,[^}]*?Fault::(\w+)",
                       (root / "firmware/supervisor/modes.hpp").read_text(encoding="utf-8"))
    rules = list(dict.fromkeys(rules))  # a fault may have several rows
    rows = re.findall(r"^\| (\w+) \|", page[page.index("## Faults"):], re.M)
    if len(rules) < 10 or [row for row in rows if row in rules] != rules:
        yield f"driving.md lists the faults as {rows}, modes.hpp runs them as {rules}"


CHECKS = [links, commands, tests, frames, names]

# A mistake of each kind: file, what is replaced, by what.
PLANTED = [
    ("README.md", "(docs/driving.md)", "(docs/drivin.md)"),
    ("README.md", "(docs/extending.md#a-motor-drive)", "(docs/extending.md#a-motor-driver)"),
    ("README.md", "wheelwright check robot.toml", "wheelwright chek robot.toml"),
    ("README.md", "--allow-soft-realtime", "--allow-realtime"),
    ("README.md", "./tools/demo", "./tools/demos"),
    ("README.md", "601#CA0004", "601#CB0004"),
    ("docs/driving.md", "601#CA0004", "61F#CA0004"),
    ("docs/driving.md", "603#EC005802F401", "603#EC005802F4"),
    ("docs/measured.md", "`chain.ChainVelocity`", "`chain.ChainVelocities`"),
    ("docs/driving.md", "stale_feedback", "old_feedback"),
    ("docs/driving.md", "| over_speed |", "| overspeed |"),
    ("docs/identification.md", "exchange drive.left.node", "change drive.left.node"),
]


def planted(root, program):
    with tempfile.TemporaryDirectory() as scratch:
        copy = pathlib.Path(scratch)
        skipped = shutil.ignore_patterns("build", ".git", ".cache", "__pycache__", "*.swp")
        shutil.copytree(root, copy, ignore=skipped, dirs_exist_ok=True)
        for path, right, wrong in PLANTED:
            file = copy / path
            text = file.read_text(encoding="utf-8")
            if right not in text:
                yield f"{path} no longer contains {right}: plant another mistake"
            file.write_text(text.replace(right, wrong), encoding="utf-8")
            if not any(problem for check in CHECKS for problem in check(copy, program)):
                yield f"not found although planted in {path}: {wrong}"
            file.write_text(text, encoding="utf-8")


def main():
    root, program = pathlib.Path(sys.argv[1]).resolve(), sys.argv[2]
    problems = [problem for check in CHECKS for problem in check(root, program)]
    if not problems:
        problems = list(planted(root, program))
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
