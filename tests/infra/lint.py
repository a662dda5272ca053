#!/usr/bin/env python3
"""clang-format or clang-tidy over the project's sources, as a test.

    lint.py format ROOT CACHE
    lint.py tidy ROOT CACHE BUILD [--only PREFIX]...

A file that passed is not judged again until something that the verdict depends on changes: the file, every
project header it includes, the tool's configuration and version, the compiler's flags. CACHE is a directory that
remembers what passed; deleting it is always safe. BUILD holds compile_commands.json and the generated headers.
"""
import argparse
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


def judge(cache, jobs):
    """jobs: (name, digest, command). Runs what did not pass before; returns how many failed."""
    cache.mkdir(parents=True, exist_ok=True)
    todo = [job for job in jobs if not (cache / job[1]).exists()]
    seconds = {}

    def run(job):
        name, key, command = job
        start = time.monotonic()
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        seconds[name] = time.monotonic() - start
        if result.returncode == 0:
            (cache / key).touch()
            return 0
        lines = [line for line in result.stdout.splitlines() if not re.match(r"\d+ (warnings|errors)? ?.*generated", line)]
        print(f"--- {name}", *lines[:60], sep="\n", flush=True)
        return 1

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        failed = sum(pool.map(run, todo))
    slowest = sorted(seconds, key=seconds.get, reverse=True)[:5]
    if slowest and seconds[slowest[0]] > 5:
        print("slowest:", ", ".join(f"{name} {seconds[name]:.0f} s" for name in slowest))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{used.ru_utime + used.ru_stime:.0f} s of processor time")
    print(f"{len(jobs)} files, {len(jobs) - len(todo)} of them known to be good, {failed} failed")
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
    """All .clang-tidy files that apply to a file."""
    places = [place / ".clang-tidy" for place in file.parents if place == root or root in place.parents]
    return "".join(place.read_text() for place in places if place.is_file())


def tidy_jobs(root, cache, build, only):
    tool = "clang-tidy-16"
    tool_version = version(tool)
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
        key = digest(closure(str(file), roots), tool_version, tidy_settings(root, file), entry["command"])
        jobs.append((name, key, [tool, "-p", str(cache), "--quiet", str(file)]))
    return jobs


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
        jobs = format_jobs(root)
    else:
        jobs = tidy_jobs(root, arguments.cache.resolve(), arguments.build.resolve(), arguments.only)
    if not jobs:
        print("no file to judge: that is not right")
        return 1
    return 1 if judge(arguments.cache, jobs) else 0


if __name__ == "__main__":
    sys.exit(main())
