"""`make instructions`: the instructions of a cycle, beside the committed ones; ends with 1 if one has grown.

    python -m tests.golden.instructions            prints and compares them
    python -m tests.golden.instructions --write    writes them into instructions.json, to be committed with the change

They are compared where processor, Python and libraries are those of the committed ones; else a line says what is not.
"""

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from footsense.benchmarks.instructions import (
    PARTS,
    CountedCycles,
    Figures,
    count_cycles,
    has_valgrind,
)

COMMITTED = Path(__file__).with_suffix(".json")
#: What a figure may grow by without being committed anew [1].
_MAX_GROWTH_REL = 0.05


class Committed(msgspec.Struct, frozen=True):
    """Content of instructions.json."""

    counted_with: dict[str, str]
    figures: Figures


def differences(now: Mapping[str, str], committed: Mapping[str, str]) -> str:
    """Return what the two were counted with that is not the same, as text; empty if all is."""
    return ", ".join(
        f"{name} is {now.get(name)}, not {value}"
        for name, value in committed.items()
        if now.get(name) != value
    )


def grown(now: Figures, committed: Figures) -> Iterator[str]:
    """Yield a line for each figure that has grown by more than 5 %."""
    for kind, figures in committed.items():
        for name, before in figures.items():
            after = now[kind][name]
            if after > (1 + _MAX_GROWTH_REL) * before:
                yield (
                    f"{kind} {name}: {after / 1e6:.3f} M instructions, {before / 1e6:.3f} M in {COMMITTED.name}: "
                    f"{100 * (after / before - 1):.0f} % more; if that is meant, commit what "
                    "`make instructions ARGS=--write` writes"
                )


def table(counted: CountedCycles, committed: Figures) -> Iterator[str]:
    """Yield the lines of a table, in millions of instructions."""
    now = counted.figures()
    yield f"{'[M instructions a cycle]':26}" + "".join(f"{kind:>10}{'committed':>11}" for kind in now)
    for name in ("median", "worst", *PARTS):
        values = ((now[kind][name], committed.get(kind, {}).get(name, 0)) for kind in now)
        label = f"  {name}, mean" if name in PARTS else name
        yield f"{label:26}" + "".join(f"{new * 1e-6:10.3f}{old * 1e-6:11.3f}" for new, old in values)
    for kind, (part, excess) in counted.excess_of_worst().items():
        yield f"the worst {kind} cycle has {excess * 1e-6:.3f} M more than the mean in {part}"
    yield f"{counted.instructions_a_second() * 1e-6:.0f} M a second at {counted.cycles_hz:.0f} cycles a second"


def main(*options: str) -> int:
    """Count, print, and compare or write."""
    writes = "--write" in options
    if not has_valgrind():
        print("instructions: not counted, there is no valgrind here")
        return int(writes)
    committed = (
        msgspec.json.decode(COMMITTED.read_bytes(), type=Committed)
        if COMMITTED.exists()
        else Committed({}, {})
    )
    counted = count_cycles("valgrind")
    print("\n".join(table(counted, committed.figures)))
    if writes:
        content = {"counted_with": counted.counted_with, "figures": counted.figures()}
        COMMITTED.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        return 0
    if unlike := differences(counted.counted_with, committed.counted_with):
        print(f"instructions: not compared with {COMMITTED.name}, as {unlike}")
        return 0
    lines = list(grown(counted.figures(), committed.figures))
    print("\n".join(lines) or "instructions: none has grown by more than 5 %")
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
