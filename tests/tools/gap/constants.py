#!/usr/bin/env python3
"""Lines and numeric constants of a tree of C++ files, folder by folder.

usage: constants.py [--list FOLDER] [ROOT ...]      default: tools/gap and tools/excite

A constant is a number literal other than 0, 1, 2, 1/2 and a conversion of units (powers of a thousand, a hundred for per cent,
60 and 180). Counted are those that have a name of their own (a constexpr), and the bare ones. Digits to which a page prints a number
(`number_text(x, 3)`) are no constants. --list prints each with its place; FOLDER as in the table.
"""
import argparse
import collections
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[3]
IGNORED = {0.0, 1.0, 2.0, 0.5, 1e2, 1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9, 60.0, 180.0}
NOISE = re.compile(r"""//[^\n]*|/\*.*?\*/|R"\((?:.|\n)*?\)"|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\])'|^\s*#\s*include[^\n]*""", re.S | re.M)
NUMBER = re.compile(r"(?<![\w.])(?:\d[\d']*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?=[uUlLfF]*(?![\w.]))")
DIGITS = re.compile(r"number_text\((?:[^()]|\([^()]*\))*?,\s*(\d+)\)|percent\((?:[^()]|\([^()]*\))*?,\s*(\d+)\)")


def without_noise(text):
    """Comments, strings and includes blanked, lines kept."""
    return NOISE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def constants(text):
    """(line, number, whether it has a name) of each."""
    text = DIGITS.sub(lambda match: re.sub(r"\d+\)$", ")", match[0]), without_noise(text))
    found, named = [], False
    for line, code in enumerate(text.splitlines(), 1):
        named = named or bool(re.search(r"\bconstexpr\b.*\bk[A-Z]\w*", code))
        for match in NUMBER.finditer(code):
            if float(match[0].replace("'", "")) not in IGNORED:
                found.append((line, match[0], named))
        named = named and not re.search(r";\s*$", code)
    return found


def main():
    parser = argparse.ArgumentParser(description="Lines and numeric constants, folder by folder")
    parser.add_argument("roots", nargs="*", default=["tools/gap", "tools/excite"])
    parser.add_argument("--list", metavar="FOLDER", help="print each constant of this folder")
    options = parser.parse_args()
    table = collections.defaultdict(lambda: [0, 0, 0, 0])
    for root in options.roots:
        for path in sorted((ROOT / root).rglob("*.?pp")):
            text = path.read_text(encoding="utf-8")
            found = constants(text)
            folder = path.parent.relative_to(ROOT).as_posix()
            names = sum(named for _, _, named in found)
            for i, count in enumerate((1, len(text.splitlines()), names, len(found) - names)):
                table[folder][i] += count
            if folder == options.list:
                for line, number, named in found:
                    print(f"{path.relative_to(ROOT)}:{line}: {number}{'' if named else '  (bare)'}")
    print(f"{'folder':24} {'files':>6} {'lines':>6} {'named':>6} {'bare':>6}")
    for folder, counts in sorted(table.items()):
        print(f"{folder:24} " + " ".join(f"{count:6}" for count in counts))
    print(f"{'all':24} " + " ".join(f"{sum(column):6}" for column in zip(*table.values())))


if __name__ == "__main__":
    main()
