#!/usr/bin/env python3
"""Plants mistakes and fails unless clang-format and clang-tidy, with the project's settings, find every one.

    lint_bites.py ROOT
"""
import pathlib
import subprocess
import sys
import tempfile

import lint

# check that must object, code
TIDY = [
    ("readability-identifier-naming", "int CamelFunction();"),
    ("readability-identifier-naming", "struct snake_type {};"),
    ("readability-identifier-naming", "class Holder { int without_underscore = 0; };"),
    ("readability-identifier-naming", "struct Open { float torqueNm = 0; };"),
    ("cppcoreguidelines-pro-type-cstyle-cast", "int narrow(const char* p) { return *(int*)p; }"),
    ("cppcoreguidelines-no-malloc", "void* take() { return __builtin_malloc(4) ? std::malloc(4) : nullptr; }"),
    ("cppcoreguidelines-avoid-goto", "int jump() { goto out; out: return 1; }"),
    ("clang-diagnostic-zero-as-null-pointer-constant", "int* none() { return 0; }"),
    ("modernize-use-override", "struct Base { virtual ~Base(); virtual void f(); }; struct Child : Base { virtual void f(); };"),
    ("google-explicit-constructor", "struct Wrap { Wrap(int value); };"),
    ("bugprone-integer-division", "double half(int n) { double x = n / 2; return x; }"),
    ("bugprone-incorrect-roundings", "int round(double x) { return static_cast<int>(x + 0.5); }"),
    ("clang-analyzer-core.DivideZero", "int by_zero(int n) { int zero = 0; return n / zero; }"),
    ("clang-analyzer-cplusplus.Move", "std::size_t gone(std::string s) { std::string t = std::move(s); return s.size() + t.size(); }"),
    ("clang-diagnostic-reserved-identifier", "int __count();"),
    ("clang-diagnostic-unreachable-code", "int after(int n) { return n; ++n; }"),
    ("clang-diagnostic-non-virtual-dtor", "struct Open2 { virtual void f(); }; struct Shut final : Open2 { void f() override; };"),
    ("bugprone-unused-raii", "struct Lock { Lock(); ~Lock(); }; int enter() { Lock(); return 1; }"),
    ("performance-for-range-copy",
     "std::size_t sizes(const std::array<std::string, 2>& all) { std::size_t n = 0; for (const auto text : all) { n += text.size(); } return n; }"),
]
# The same names as they should be.
CLEAN = """
constexpr double kWheelRadius_m = 0.075;
struct Wheel { float torque_Nm = 0; double kinetic_energy_J = 0; float k7_per_Nm2 = 0; };
class Counter {
  public:
    void count() { ++value_; }
    int value() const { return value_; }

  private:
    int value_ = 0;
};
template <typename Real, int N, bool kVariable>
Real twice(Real x_m) { return x_m * (kVariable ? N : 2); }
"""
HEADERS = "#include <array>\n#include <cstdlib>\n#include <string>\n#include <utility>\n"


def tidy(root, file, code):
    file.write_text(HEADERS + code + "\n")
    return judge(root, file)


def judge(root, file):
    command = ["clang-tidy-16", f"--config-file={root / '.clang-tidy'}", "--quiet", str(file), "--", "-std=c++20"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    problems = []
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "planted.cpp"
        spaces = [f"namespace case_{i} {{\n{code}\n}}" for i, (_, code) in enumerate(TIDY)]
        output = tidy(root, file, "\n".join(spaces)).stdout
        for i, (check, code) in enumerate(TIDY):
            line = len(HEADERS.splitlines()) + 3 * i + 2
            if not any(f"planted.cpp:{line}:" in found and check in found for found in output.splitlines()):
                problems.append(f"{check} does not object to: {code}")
        result = tidy(root, file, CLEAN)
        if result.returncode != 0:
            problems.append(f"clean code is refused:\n{result.stdout}")

        # Judged together, as lint.py does it: the file with the mistakes is found, and not its neighbours.
        (pathlib.Path(folder) / "clean.cpp").write_text(HEADERS + CLEAN)
        tidy(root, file, "\n".join(spaces))
        for names in (["clean.cpp", "planted.cpp"], ["planted.cpp", "clean.cpp"]):
            batch = lint.Batch(pathlib.Path(folder), pathlib.Path(folder) / "batch.cpp", None)
            batch.write(names)
            objected = batch.objected(judge(root, batch.file).stdout)
            if objected != {"planted.cpp"}:
                problems.append(f"of {names} judged together, those objected to are {sorted(objected)}")

        style = f"--style=file:{root / '.clang-format'}"
        file.write_text("int  f( int a ){return a;}\n")
        if subprocess.run(["clang-format-16", style, "--dry-run", "-Werror", file], capture_output=True, check=False).returncode == 0:
            problems.append("clang-format does not object to spaces in the wrong places")
    for problem in problems:
        print(problem)
    print(f"{len(TIDY) + 3} planted mistakes looked for")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
