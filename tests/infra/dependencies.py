#!/usr/bin/env python3
"""Judges the direction of #include in every source file against the project's rules, then plants violations of
each rule in a copy and fails unless every one is found.

    dependencies.py ROOT
"""
import pathlib
import re
import shutil
import sys
import tempfile

SUFFIXES = {".hpp", ".cpp", ".h", ".c"}
CORE = ["firmware/model/", "firmware/ident/", "firmware/control/", "firmware/supervisor/", "firmware/protocol/"]
GENERATED = re.compile(r"(firmware/protocol|drivers/\w+)/\w+_messages\.hpp")

# What the portable core may take from the C++ library: nothing here allocates, throws on its own, or needs an
# operating system. (<cstdlib> is for std::abs of integers; the link for the bare target proves that nothing calls
# its malloc.)
CORE_HEADERS = set("""algorithm array bit cmath compare concepts cstddef cstdint cstdlib initializer_list limits numbers
    optional span string_view tuple type_traits utility variant""".split())
# Of an operating system, or of a program with files and threads. <atomic> and <cstring> are neither.
MACHINE_HEADERS = re.compile(
    r".*/.*|.*\.h|cstdio|iostream|fstream|thread|mutex|shared_mutex|condition_variable|future|filesystem|chrono|"
    r"csignal|stop_token|semaphore")

# folder: (project headers it may include, judge of the other headers)
def core_system(header):
    return header in CORE_HEADERS or header.startswith("Eigen/")


def portable_system(header):
    return header.startswith("Eigen/") or not MACHINE_HEADERS.fullmatch(header)


def any_system(_header):
    return True


def named(*prefixes):
    return lambda header: header.startswith(prefixes)


def tools_without(*forbidden, but=()):
    """What tools may include, without these folders `but` those."""
    return lambda header: header.startswith(tuple(but)) or not header.startswith(("tests/", *forbidden))


def sim_may_include(header):
    """The simulated drives are written from the protocol, so they see the drives' frames but no driver."""
    if header.startswith("drivers/"):
        return header == "drivers/motor_drive.hpp" or bool(GENERATED.fullmatch(header))
    return header.startswith(("sim_hal/", "hal/", "firmware/model/", "firmware/protocol/"))


STAGES = ["logs", "hypotheses", "model", "inference"]
RULES = {
    **{folder: (named(*CORE), core_system) for folder in CORE},
    # The model stands below everything else in the core, and the control laws do not know who identified it.
    "firmware/model/": (named("firmware/model/"), core_system),
    "firmware/protocol/": (named("firmware/protocol/"), core_system),
    "firmware/task/": (named("firmware/", "hal/", "drivers/"), any_system),
    "hal/linux/": (named("hal/"), any_system),
    "hal/": (named("hal/"), portable_system),
    "drivers/": (named("drivers/", "hal/", "firmware/model/", "firmware/protocol/"), portable_system),
    "sim_hal/": (sim_may_include, portable_system),
    # The trials' robots know nothing of what the analysis is made of.
    "tools/gap_trials/hidden/": (named("tools/gap_trials/hidden/"), any_system),
    "tools/gap_exam/truth/": (named("tools/gap_exam/truth/", "tools/gap_trials/hidden/random.hpp"), any_system),
    # The gap analysis in one direction: what was measured, what may be missing, the model, what is concluded, what is
    # said of it.
    **{f"tools/gap/{folder}/": (tools_without("tools/gap/", but=[f"tools/gap/{earlier}/" for earlier in STAGES[: i + 1]]),
                                any_system) for i, folder in enumerate(STAGES)},
    "tools/excite/": (tools_without("tools/gap/"), any_system),
    "tools/": (lambda header: not header.startswith("tests/"), any_system),
    "toolchain/": (named("toolchain/"), any_system),
    "tests/": (lambda header: True, any_system),
}


def folder_of(path):
    return max((folder for folder in RULES if path.startswith(folder)), key=len, default=None)


def violations(root):
    found = []
    for file in sorted(root.rglob("*")):
        path = file.relative_to(root).as_posix()
        if file.suffix not in SUFFIXES or path.startswith(("build", ".")) or not file.is_file():
            continue
        folder = folder_of(path)
        if folder is None:
            found.append(f"{path}: lies in no folder of the project's layout")
            continue
        project_rule, system_rule = RULES[folder]
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
            match = re.match(r'\s*#\s*include\s*(<([^>]+)>|"([^"]+)")', line)
            if not match:
                continue
            where = f"{path}:{number}: "
            if match[2]:
                if not system_rule(match[2]):
                    found.append(f"{where}{folder} may not include <{match[2]}>")
            elif not (root / match[3]).is_file() and not GENERATED.fullmatch(match[3]):
                found.append(f'{where}"{match[3]}" is not a path from the root of the repository')
            elif not project_rule(match[3]):
                found.append(f'{where}{folder} may not include "{match[3]}"')
    return found


# One violation of each rule: file it is planted in, line.
PLANTED = [
    ("firmware/model/types.hpp", "#include <vector>"),
    ("firmware/model/types.hpp", '#include "firmware/ident/ud_rls.hpp"'),
    ("firmware/ident/ud_rls.hpp", "#include <sys/mman.h>"),
    ("firmware/ident/ud_rls.hpp", '#include "firmware/task/telemetry.hpp"'),
    ("firmware/control/limits.hpp", '#include "hal/clock.hpp"'),
    ("firmware/control/limits.hpp", "#include <memory>"),
    ("firmware/supervisor/supervisor.hpp", '#include "drivers/motor_drive.hpp"'),
    ("firmware/protocol/codec.hpp", "#include <string>"),
    ("firmware/task/telemetry.hpp", '#include "sim_hal/plant.hpp"'),
    ("firmware/task/telemetry.hpp", '#include "telemetry.hpp"'),
    ("hal/can_bus.hpp", '#include "firmware/model/types.hpp"'),
    ("hal/can_bus.hpp", "#include <linux/can.h>"),
    ("drivers/motor_drive.hpp", '#include "firmware/task/telemetry.hpp"'),
    ("drivers/motor_drive.hpp", "#include <unistd.h>"),
    ("sim_hal/plant.hpp", '#include "firmware/control/limits.hpp"'),
    ("sim_hal/plant.hpp", '#include "firmware/task/telemetry.hpp"'),
    ("sim_hal/plant.hpp", "#include <thread>"),
    ("tools/main.cpp", '#include "tests/support/main.cpp"'),
    ("tools/gap_trials/hidden/plant.hpp", '#include "firmware/model/types.hpp"'),
    ("tools/gap_trials/hidden/ode_plant.cpp", '#include "sim_hal/plant.hpp"'),
    ("tools/gap_trials/hidden/trial.cpp", '#include "tools/logs/measured_csv.hpp"'),
    ("tools/gap_exam/truth/laws.hpp", '#include "firmware/model/effects.hpp"'),
    ("tools/gap_exam/truth/simulator.cpp", '#include "tools/gap_trials/hidden/robot.hpp"'),
    ("tools/gap/logs/sensors.hpp", '#include "tools/gap/model/rows.hpp"'),
    ("tools/gap/hypotheses/contribution.hpp", '#include "tools/gap/model/rows.hpp"'),
    ("tools/gap/model/rows.hpp", '#include "tools/gap/inference/outcome.hpp"'),
    ("tools/gap/inference/outcome.cpp", '#include "tools/gap/analysis.hpp"'),
    ("tools/gap/inference/outcome.cpp", '#include "tools/gap/report/output.hpp"'),
    ("tools/excite/motions.hpp", '#include "tools/gap/model/fit.hpp"'),
    ("stray/file.cpp", "#include <array>"),
]


def missed_plants(root):
    missed = []
    with tempfile.TemporaryDirectory() as scratch:
        copy = pathlib.Path(scratch) / "copy"
        for file in sorted(root.rglob("*")):
            path = file.relative_to(root)
            if file.suffix in SUFFIXES and file.is_file() and not path.as_posix().startswith(("build", ".")):
                (copy / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file, copy / path)
        for path, line in PLANTED:
            file = copy / path
            before = file.read_text(encoding="utf-8") if file.is_file() else None
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f"{line}\n{before or ''}", encoding="utf-8")
            if not any(found.startswith((f"{path}:1: ", f"{path}: ")) for found in violations(copy)):
                missed.append(f"not found although planted in {path}: {line}")
            if before is None:
                file.unlink()
            else:
                file.write_text(before, encoding="utf-8")
    return missed


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    problems = violations(root) + missed_plants(root)
    for problem in problems:
        print(problem)
    print(f"{len(PLANTED)} planted violations looked for")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
