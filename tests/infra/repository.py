#!/usr/bin/env python3
"""Housekeeping of the repository, as tests.

    repository.py no_machine_paths ROOT   nothing names a place on one particular machine
    repository.py shell_scripts ROOT      shellcheck finds nothing in any shell script
    repository.py scripts_run ROOT        what starts with #! can be executed, and nothing else can
    repository.py no_large_files ROOT     nothing over 500 kB
    repository.py packages ROOT           the package lists name each package once, in one of them
"""
import os
import pathlib
import re
import subprocess
import sys

# SC2317: takes what a trap calls for unreachable. SC2016: a script handed to another shell is quoted on purpose.
IGNORED = "SC2317,SC2016"
SKIPPED = {".git", "build", ".cache", "__pycache__"}


def files(root):
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if name not in SKIPPED)
        for name in sorted(names):
            path = pathlib.Path(folder) / name
            # In a second work tree .git is a file.
            if not path.is_symlink() and not name.endswith(".swp") and name not in SKIPPED:
                yield path


def first_line(path):
    with path.open("rb") as file:
        return file.readline(200)


def no_machine_paths(root):
    # Written in pieces so that this file does not find itself.
    forbidden = re.compile(rb"/(work|farm|home|Users)" rb"/[a-z]|/tm" rb"p/[a-z]+[0-9/]|\.lib" rb"rary/")
    for path in files(root):
        for number, line in enumerate(path.read_bytes().splitlines(), 1):
            if forbidden.search(line):
                yield f"{path.relative_to(root)}:{number}: {line.decode(errors='replace').strip()[:120]}"


def shell_scripts(root):
    scripts = [path for path in files(root) if re.match(rb"#!.*\b(sh|bash)\b", first_line(path)) or path.suffix == ".sh"]
    if len(scripts) < 5:
        yield f"only {len(scripts)} shell scripts found: the search is broken"
    result = subprocess.run(["shellcheck", "-x", "-e", IGNORED, *map(str, scripts)], cwd=root, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        yield result.stdout + result.stderr
    print(f"{len(scripts)} shell scripts")


def scripts_run(root):
    for path in files(root):
        runs, script = os.access(path, os.X_OK), first_line(path).startswith(b"#!")
        if runs != script:
            yield f"{path.relative_to(root)}: " + ("has #! but cannot be executed" if script else "executable without #!")


def no_large_files(root):
    for path in files(root):
        if path.stat().st_size > 500_000:
            yield f"{path.relative_to(root)}: {path.stat().st_size} bytes"


def packages(root):
    home = {}
    for path in sorted((root / "tools/lib").glob("packages.*")):
        if path.suffix == ".sh":
            continue
        for number, line in enumerate(path.read_text().splitlines(), 1):
            name = line.split("#")[0].strip()
            if name and not re.fullmatch(r"[a-z0-9][a-z0-9+.-]+", name):
                yield f"{path.name}:{number}: not a package name: {name}"
            if name and name in home:
                yield f"{path.name}:{number}: {name} is also in {home[name]}"
            if name:
                home[name] = path.name
    if not home:
        yield "no package lists found"


def main():
    checks = {check.__name__: check for check in (no_machine_paths, shell_scripts, scripts_run, no_large_files, packages)}
    problems = list(checks[sys.argv[1]](pathlib.Path(sys.argv[2]).resolve()))
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
