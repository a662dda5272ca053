"""alike.py ONE OTHER: whether two JSON files differ in nothing but the last digits of numbers, and their own names."""
import json
import math
import sys

RELATIVE = 1e-6


def different(one, other, where=""):
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return next((d for key in one if (d := different(one[key], other[key], f"{where}.{key}"))), None)
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return next((d for i, pair in enumerate(zip(one, other)) if (d := different(*pair, f"{where}[{i}]"))), None)
    if isinstance(one, float) and isinstance(other, (int, float)) and math.isclose(one, other, rel_tol=RELATIVE, abs_tol=1e-12):
        return None
    return None if one == other else f"{where}: {one} and {other}"


def main():
    files = []
    for path in sys.argv[1:3]:
        with open(path, encoding="utf-8") as file:
            files.append(json.load(file))
    if problem := different(*files):
        sys.exit(problem)


if __name__ == "__main__":
    main()
