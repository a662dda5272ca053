#!/usr/bin/env python3
"""clang-format or clang-tidy over the project's sources, as a test.

    lint.py format ROOT CACHE
    lint.py tidy ROOT CACHE BUILD [--only PREFIX]...

A file that passed is not judged again until something that the verdict depends on changes: the file, every
project header it includes, the tool's configuration and version, the compiler's flags. CACHE is a directory that
remembers what passed; deleting it is always safe. BUILD holds compile_commands.json and the generated headers.

Most of clang-tidy's time goes into headers, which it walks again for every file. So several files are judged as one,
written one after the other, with their headers once. (Including them would not do: the static analyser and some
warnings look at the main file alone.) A batch only ever says "all of these are good": where it objects, or its files
do not go together, each is judged alone, and that verdict counts.
"""
import argparse
import bisect
import concurrent.futures
import functools
import hashlib
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import time

TIDY = "clang-tidy-16"
FOLDERS = ["firmware", "hal", "drivers", "sim_hal", "tools", "tests", "toolchain"]
INCLUDE = re.compile(rb'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)


@functools.cache
def content(path):
    try:
        return pathlib.Path(path).read_bytes()
    except FileNotFoundError:
        return None


@functools.cache
def includes(path, roots):
    """The project's own headers that `path` names."""
    data = content(path) or b""
    found = []
    for name in INCLUDE.findall(data):
        candidates = [os.path.join(root, name.decode()) for root in roots]
        found += [candidate for candidate in candidates if content(candidate) is not None][:1]
    return found


def closure(path, roots):
    seen, waiting = set(), [path]
    while waiting:
        file = waiting.pop()
        if file not in seen:
            seen.add(file)
            waiting += includes(file, roots)
    return sorted(seen)


def digest(files, *texts):
    h = hashlib.sha256()
    for text in texts:
        h.update(text.encode() + b"\0")
    for file in files:
        h.update(file.encode() + b"\0" + (content(file) or b"") + b"\0")
    return h.hexdigest()


def version(tool):
    return subprocess.run([tool, "--version"], capture_output=True, text=True, check=True).stdout


def judge(cache, jobs, batches=()):
    """jobs: (name, digest, command); batches: of Batch. Runs what did not pass before, in batches as far as
    they go; returns how many failed."""
    cache.mkdir(parents=True, exist_ok=True)
    todo = {job[0]: job for job in jobs if not (cache / job[1]).exists()}
    waiting = len(todo)
    seconds = {}

    def run(name, command):
        start = time.monotonic()
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        seconds[name] = time.monotonic() - start
        return result

    def run_batch(batch):
        """Those that it objects to are taken out, and the others tried once more."""
        while len(batch.names) > 1:
            result = run(f"{batch.names[0]} and {len(batch.names) - 1} more", batch.command)
            if result.returncode == 0:
                for name in batch.names:
                    (cache / todo.pop(name)[1]).touch()
                return
            objected = batch.objected(result.stdout)
            print(f"judged one by one: {', '.join(sorted(objected or batch.names))}", flush=True)
            if not objected:  # a header, or files that do not go together
                print(*result.stdout.splitlines()[:8], sep="\n", flush=True)
                return
            batch.write([name for name in batch.names if name not in objected])

    def run_one(job):
        name, key, command = job
        result = run(name, command)
        if result.returncode == 0:
            (cache / key).touch()
            return 0
        lines = [line for line in result.stdout.splitlines() if not re.match(r"\d+ (warnings|errors)? ?.*generated", line)]
        print(f"--- {name}", *lines[:60], sep="\n", flush=True)
        return 1

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(run_batch, batches))
        failed = sum(pool.map(run_one, todo.values()))
    slowest = sorted(seconds, key=seconds.get, reverse=True)[:5]
    if slowest and seconds[slowest[0]] > 5:
        print("slowest:", ", ".join(f"{name} {seconds[name]:.0f} s" for name in slowest))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{used.ru_utime + used.ru_stime:.0f} s of processor time")
    print(f"{len(jobs)} files, {len(jobs) - waiting} of them known to be good, {failed} failed")
    return failed


def format_jobs(root):
    tool = "clang-format-16"
    files = [path for folder in FOLDERS for path in sorted((root / folder).rglob("*")) if path.suffix in {".hpp", ".cpp"}]
    settings = version(tool) + (root / ".clang-format").read_text()
    return [
        (path.relative_to(root).as_posix(), digest([str(path)], settings), [tool, "--dry-run", "-Werror", str(path)])
        for path in files
    ]


def tidy_settings(root, file):
    """All .clang-tidy files that apply to a file, outermost last."""
    places = [place / ".clang-tidy" for place in file.parents if place == root or root in place.parents]
    return [place for place in places if place.is_file()]


# Names at the start of a line, where clang-format puts what is declared in a namespace.
DECLARED = re.compile(rb"^(?![\s/#}]|namespace|using [\w:]+;|using namespace)[^\n]*?(\w+)(?:\(|\{| \{| =|;|\[)", re.MULTILINE)
TYPE = re.compile(rb"^(?:struct|class|enum class|enum|union) (\w+)", re.MULTILINE)
ANY_INCLUDE = re.compile(rb"^#include\s+(\S+).*$", re.MULTILINE)
BATCH = 16
NOT_IN_A_BATCH = "--checks=-readability-duplicate-include"


def batches_of(files):
    """Files that can be compiled as one: no name is declared in two of them. What this overlooks, the compiler sees.
    A file that includes something twice is left out: that is not seen in a batch."""
    batches = []
    for file in files:
        data = content(str(file)) or b""
        own = ANY_INCLUDE.findall(data)
        if len(own) > len(set(own)):
            continue
        names = {*DECLARED.findall(data), *TYPE.findall(data)} - {b"TEST", b"TEST_GROUP"}
        for members, taken in batches:
            if len(members) < BATCH and not names & taken:
                members.append(file)
                taken |= names
                break
        else:
            batches.append(([file], names))
    return [members for members, _ in batches]


class Batch:
    """Several sources as one file, with all that they include at the top: CppUTest's macros disturb what follows."""

    def __init__(self, root, file, command):
        self.root, self.file, self.command = root, file, command
        self.names, self.lines = [], []

    def write(self, names):
        self.names = names
        sources = [content(str(self.root / name)) for name in names]
        included = dict.fromkeys(name for source in sources for name in ANY_INCLUDE.findall(source))
        included = sorted(included, key=lambda name: name.startswith(b"<CppUTest"))
        text = b"".join(b"#include " + name + b"\n" for name in included)
        self.lines = []  # after which each begins
        for source in sources:
            self.lines.append(text.count(b"\n"))
            text += ANY_INCLUDE.sub(b"", source)
        self.file.write_bytes(text)

    def objected(self, output):
        """The names of those that the output objects to."""
        lines = re.findall(re.escape(str(self.file)) + r":(\d+):\d+: (?:error|warning)", output)
        return {self.names[bisect.bisect_left(self.lines, int(line)) - 1] for line in lines if int(line) > self.lines[0]}


def tidy_batches(root, cache, entries, keys):
    """For files judged by the same settings and compiled by the same flags."""
    groups = {}
    for name in keys:
        entry = entries[str(root / name)]
        flags = re.sub(r" -O\d\b| -o \S+ -c \S+$", "", entry["command"])
        settings = tuple(tidy_settings(root, root / name))
        groups.setdefault((flags, settings), []).append(root / name)
    batches, database = [], []
    for number, ((flags, settings), files) in enumerate(groups.items()):
        for place, members in enumerate(batches_of(files)):
            # Where it lies decides which settings apply.
            top = cache / "batches"
            for setting in settings:
                copy = top / setting.relative_to(root)
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_text(setting.read_text())
            file = top / settings[0].parent.relative_to(root) / f"batch_{number}_{place}.cpp"
            database.append({"directory": str(cache), "file": str(file), "command": f"{flags} -c {file}"})
            command = [TIDY, "-p", str(cache / "batches"), NOT_IN_A_BATCH, "--quiet", str(file)]
            batches.append(Batch(root, file, command))
            batches[-1].write([member.relative_to(root).as_posix() for member in members])
    if database:
        (cache / "batches" / "compile_commands.json").write_text(json.dumps(database))
    return batches


def tidy_jobs(root, cache, build, only):
    tool_version = version(TIDY)
    roots = (str(root), str(build / "generated"))
    # A file compiled into several programs is judged once: clang-tidy would do it for each entry of the database.
    entries = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        entries.setdefault(entry["file"], entry)
    cache.mkdir(parents=True, exist_ok=True)
    (cache / "compile_commands.json").write_text(json.dumps(list(entries.values())))
    jobs = []
    for entry in entries.values():
        file = pathlib.Path(entry["file"])
        name = file.relative_to(root).as_posix() if root in file.parents else None
        if name is None or not name.endswith(".cpp") or (only and not name.startswith(tuple(only))):
            continue
        settings = "".join(place.read_text() for place in tidy_settings(root, file))
        key = digest(closure(str(file), roots), tool_version, settings, entry["command"])
        jobs.append((name, key, [TIDY, "-p", str(cache), "--quiet", str(file)]))
    waiting = [name for name, key, _ in jobs if not (cache / key).exists()]
    return jobs, tidy_batches(root, cache, entries, waiting)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["format", "tidy"])
    parser.add_argument("root", type=pathlib.Path)
    parser.add_argument("cache", type=pathlib.Path)
    parser.add_argument("build", type=pathlib.Path, nargs="?")
    parser.add_argument("--only", action="append", default=[])
    arguments = parser.parse_args()
    root = arguments.root.resolve()
    if arguments.what == "format":
        jobs, batches = format_jobs(root), []
    else:
        jobs, batches = tidy_jobs(root, arguments.cache.resolve(), arguments.build.resolve(), arguments.only)
    if not jobs:
        print("no file to judge: that is not right")
        return 1
    return 1 if judge(arguments.cache, jobs, batches) else 0


if __name__ == "__main__":
    sys.exit(main())
