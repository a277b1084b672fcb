"""Scans with each kind of FDC1004 that its data sheet allows: how many readings are OK, and whether these are right.

What clears the DONE bit of a conversion, and what a result reads as while it is converted, is not said
(`sim/chips/fdc1004.py`). The feet are pressed ever harder, so that a reading of another conversion shows.
"""

import itertools
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache
from typing import NamedTuple

import numpy as np

from footsense.acquisition.scanner import BusScanner
from footsense.config import SMALL_BOARD
from footsense.daemon.acquisition import open_buses
from footsense.daemon.simulation import simulated_robot
from footsense.frames import Reading
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import Constant

#: Kinds of chip by the words of their table.
KINDS = {
    f"{'both registers' if both else 'upper register'}{', next trigger' if trigger else ''} | "
    f"{'old result' if keeps else '0x7FFFFF'}": Effects(
        trigger_clears_done=trigger, done_needs_both_reads=both, keeps_old_result=keeps
    )
    for both, trigger, keeps in itertools.product((False, True), repeat=3)
}
#: Relative excess of the conversion times of all chips [1]; 2 % are within their tolerance.
CLOCK_ERRORS_REL = (0.0, 0.04, 0.07, 0.12)
#: Cost of a transaction on the host [us].
HOST_COST_US = 40.0
#: Scans, and the scan after which the converter of one leg hangs until it is reset.
N_SCANS, HANGS_AFTER = 60, 20
#: Error beyond which a reading is of another conversion [fF]: two codes; a scan moves a capacitance by ten times that.
_TOLERANCE_FF = 1.0


class KindFigures(NamedTuple):
    """Readings of one kind of chip at one clock.

    Attributes:
        ok_rel: Share of the readings that are OK [1].
        n_wrong: Readings that are OK and not of their conversion.
        scan_ms: Mean time of a scan before the hang [ms].
    """

    ok_rel: float
    n_wrong: int
    scan_ms: float


def converter_kind_figures(effects: Effects, clock_error_rel: float) -> KindFigures:
    """Scan six legs with one kind of chip, of which one hangs; return how many readings are OK, and how many wrong.

    Args:
        effects: The kind.
        clock_error_rel: Relative excess of the conversion times [1].

    Raises:
        ModelError: The response table of the feet is missing.
    """
    scene = Scene(
        description="All feet are pressed ever harder.",
        load=Constant(force_n=(0.0, 0.0, 2.0), rise_s=3.0),
        lead_in_s=0.0,
        host_cost_us=HOST_COST_US,
        effects=effects,
    )
    robot = simulated_robot(SMALL_BOARD, scene)
    chips = [leg.chips[0] for leg in robot.legs.values()]
    for chip in chips:
        assert isinstance(chip, SimulatedFdc1004)
        chip.clock_factor = 1.0 + clock_error_rel
    # The feet are alike, and so are their loads.
    true_pf = cache(next(iter(robot.legs.values())).wired.elements_pf)
    with ExitStack() as stack:
        ((bus, clock),) = open_buses(SMALL_BOARD, robot, stack)
        scanner = BusScanner(bus, clock, SMALL_BOARD.buses[0].channels, SMALL_BOARD.triggered_plan)
        scanner.start()
        n_ok = n_wrong = 0
        start_ns, scan_ns = clock.now_ns(), 0.0
        for n in range(N_SCANS):
            if n == HANGS_AFTER:
                scan_ns = (clock.now_ns() - start_ns) / n
                hanging = chips[-1]
                assert isinstance(hanging, SimulatedFdc1004)
                hanging.hangs_ns.append(clock.now_ns())
            frame = scanner.read()
            while frame.sequence % len(scanner.plan.steps):
                frame = scanner.read()
            ok = frame.reading == Reading.OK
            n_ok += int(ok.sum())
            for row, element in np.argwhere(ok).tolist():
                error_pf = (
                    frame.capacitance_pf[row, element] - true_pf(int(frame.t_ns[row, element]))[element]
                )
                n_wrong += abs(error_pf) * 1e3 > _TOLERANCE_FF
    return KindFigures(n_ok / (N_SCANS * ok.size), int(n_wrong), scan_ns * 1e-6)


def simulate_converter_kinds(
    report: Callable[[str], None], *, quick: bool = False
) -> dict[str, dict[str, KindFigures]]:
    """Return the figures of every kind of chip, by its words and its clock; see `converter_kind_figures`.

    Args:
        report: Called with the words of each kind as it is complete.
        quick: Whether only the first and the last clock are tried.
    """
    found = {}
    for words, effects in KINDS.items():
        found[words] = {
            f"{100 * error_rel:.0f} %": converter_kind_figures(effects, error_rel)
            for error_rel in CLOCK_ERRORS_REL[:: len(CLOCK_ERRORS_REL) - 1 if quick else 1]
        }
        report(words.replace(" | ", ", "))
    return found
