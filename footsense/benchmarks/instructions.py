"""Instructions of the service's cycles and of their parts: a cost that is the same on a busy and on a quiet machine.

A process of its own runs recorded cycles and marks the boundaries of their parts (`counted_cycles.py`). The kernel
counts its instructions where it has a counter, else valgrind does. Its simulated processor has no AVX-512: on every
x86-64 with AVX2 it executes the same instructions. Only those of user space are counted.
"""

import logging
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from importlib.metadata import version
from itertools import accumulate, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import msgspec
import numpy as np

from footsense.benchmarks.counted_cycles import Marks
from footsense.benchmarks.perf_event import can_count
from footsense.benchmarks.recorded_walk import record_walk
from footsense.errors import FootsenseError

Counter = Literal["perf", "valgrind"]
#: Instructions by part.
Parts = dict[str, int]
#: Instructions of a cycle by kind and name: `median`, `worst`, and the means of the parts.
Figures = dict[str, Parts]

#: The parts of a cycle; `loop` is what no other has.
PARTS = ("network", "estimation", "contact", "acquisition", "can", "ring", "loop")
#: Cycles of each kind that are counted.
N_CYCLES, N_CYCLES_QUICK = 24, 4

#: Of this process's environment; all else could change what is executed.
_KEPT_VARIABLES = ("PATH", "LD_LIBRARY_PATH", "PYTHONPATH")
_ENVIRONMENT = {"PYTHONHASHSEED": "0", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
#: Options of a build of Python that change its instructions.
_BUILD_OPTIONS = re.compile(r"--(?:enable-optimizations|enable-shared|with-lto|with-pydebug)\b")
_PACKAGES = ("numpy", "onnxruntime", "msgspec")


class CountedCycles(msgspec.Struct, frozen=True):
    """Counted cycles, of a walk without faults and with some.

    Attributes:
        counted_with: Counter, processor and versions; other ones execute other instructions.
        cycles_hz: Cycles a second.
        healthy: Instructions of each cycle without faults, by part.
        faulty: The same with faults.
    """

    counted_with: dict[str, str]
    cycles_hz: float
    healthy: list[Parts]
    faulty: list[Parts]

    def figures(self) -> Figures:
        """Return the instructions of a cycle of both kinds: median and worst, and the mean of each part."""
        return {"healthy": _figures_of(self.healthy), "faulty": _figures_of(self.faulty)}

    def excess_of_worst(self) -> dict[str, tuple[str, int]]:
        """Return by kind the part in which the worst cycle exceeds the mean most, and by how many instructions."""
        found = {}
        for kind, cycles in (("healthy", self.healthy), ("faulty", self.faulty)):
            means, worst = _figures_of(cycles), max(cycles, key=lambda cycle: sum(cycle.values()))
            part = max(PARTS, key=lambda part: worst[part] - means[part])
            found[kind] = part, worst[part] - means[part]
        return found

    def instructions_a_second(self) -> int:
        """Return the instructions of a second of walking without faults."""
        return round(self.cycles_hz * float(np.mean(_totals(self.healthy))))


def _totals(cycles: Sequence[Parts]) -> list[int]:
    return [sum(cycle.values()) for cycle in cycles]


def _figures_of(cycles: Sequence[Parts]) -> Parts:
    totals = _totals(cycles)
    means = {part: round(float(np.mean([cycle[part] for cycle in cycles]))) for part in PARTS}
    return {"median": round(float(np.median(totals))), "worst": max(totals), **means}


def usable_counter() -> Counter | None:
    """Return the best counter of this machine; None if it has none."""
    if can_count():
        return "perf"
    return "valgrind" if has_valgrind() else None


def has_valgrind() -> bool:
    """Return whether valgrind is installed."""
    return shutil.which("valgrind") is not None and shutil.which("vgdb") is not None


def count_cycles(counter: Counter, n_cycles: int = N_CYCLES) -> CountedCycles:
    """Return the instructions of cycles without faults and with some.

    Args:
        counter: What counts.
        n_cycles: Cycles of each kind.

    Raises:
        FootsenseError: The counted process failed.
    """
    logging.disable()  # the faults are on purpose
    try:
        walk = record_walk(n_cycles, n_cycles)
    finally:
        logging.disable(logging.NOTSET)
    with TemporaryDirectory() as folder:
        recorded, marked, counts = (Path(folder) / name for name in ("walk", "marks", "counts"))
        recorded.write_bytes(msgspec.msgpack.encode(walk))
        command = [sys.executable, "-P", "-m", "footsense.benchmarks.counted_cycles"]
        command += [str(recorded), str(marked)]
        if counter == "perf":
            command.append("--perf")
        else:
            command = [*_valgrind_command(counts), *command]
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        run = subprocess.run(  # noqa: S603 - our own module
            command, env=kept | _ENVIRONMENT, stdin=subprocess.DEVNULL, capture_output=True, check=False
        )
        if run.returncode:
            text = run.stderr.decode(errors="replace").strip()
            raise FootsenseError(f"the process whose instructions are counted failed: {text}")
        marks = msgspec.json.decode(marked.read_bytes(), type=Marks)
        if counter == "valgrind":
            marks.counts = list(accumulate(dumped_counts(counts, len(marks.names))))
    cycles = costs_of_cycles(marks, walk.n_transactions)
    return CountedCycles(
        counted_with=counted_with(counter),
        cycles_hz=1e9 / walk.cycle_ns,
        healthy=cycles[:n_cycles],
        faulty=cycles[n_cycles:],
    )


def _valgrind_command(counts: Path) -> list[str]:
    return [
        *("valgrind", "--tool=callgrind", f"--callgrind-out-file={counts}"),
        *("--instr-atstart=no", "--dump-before=getppid", "--dump-line=no"),
    ]


def counted_with(counter: Counter) -> dict[str, str]:
    """Return what decides how many instructions a cycle takes: counter, processor, builds and versions."""
    options = _BUILD_OPTIONS.findall(sysconfig.get_config_var("CONFIG_ARGS") or "")
    return {
        "counter": counter,
        "machine": f"{platform.machine()}{' avx2' if 'avx2' in _cpu_words() else ''}",
        "python": platform.python_version(),
        "python_build": " ".join([platform.python_compiler(), *sorted(set(options))]),
        "libc": " ".join(platform.libc_ver()),
        **{package: version(package) for package in _PACKAGES},
    }


def _cpu_words() -> list[str]:
    cpuinfo = Path("/proc/cpuinfo")
    return cpuinfo.read_text(errors="replace").split() if cpuinfo.exists() else []


def dumped_counts(counts: Path, n: int) -> list[int]:
    """Return the instructions before each of `n` marks since the last one, from the files that callgrind wrote.

    Raises:
        FootsenseError: One is missing, or has no total.
    """
    found = []
    for number in range(1, n + 1):
        path = counts.with_name(f"{counts.name}.{number}")
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        total = re.search(r"^totals: (\d+)$", text, re.MULTILINE)
        if total is None:
            raise FootsenseError(f"valgrind wrote no count for mark {number} of {n}")
        found.append(int(total[1]))
    return found


def costs_of_cycles(marks: Marks, n_transactions: Sequence[int]) -> list[Parts]:
    """Return the instructions of each cycle by part, without those of marks and of what stands for the kernel.

    Args:
        marks: Marks and counts; behind the cycles are calls of an empty function, then of what stands for the kernel.
        n_transactions: Transactions of each cycle.
    """
    *cycles, empty, answers = _calls(marks)
    inside = _median_of(empty, "nothing")
    outside = _median_of(empty, "empty")
    answer = _median_of(answers, "answer") - inside
    costs = []
    for cycle, n in zip(cycles, n_transactions, strict=True):
        parts = dict.fromkeys(PARTS, 0)
        for part, instructions, begins in cycle:
            parts[part] += instructions - (inside if begins else outside)
        parts["acquisition"] -= answer * n
        costs.append(parts)
    return costs


#: Stretches between two marks: part, instructions, and whether its call begins here; else another call in it has ended.
_Stretches = list[tuple[str, int, bool]]


def _calls(marks: Marks) -> list[_Stretches]:
    """Return the stretches of each outermost call."""
    calls, within = list[_Stretches](), list[str]()
    for name, (before, after) in zip(marks.names, pairwise([*marks.counts, marks.counts[-1]]), strict=True):
        begins = name.startswith("+")
        if begins:
            if not within:
                calls.append([])
            within.append(name[1:])
        else:
            within.pop()
        if within:
            calls[-1].append((within[-1], after - before, begins))
    return calls


def _median_of(call: _Stretches, part: str) -> int:
    return round(float(np.median([instructions for name, instructions, _ in call if name == part])))
