"""Scans a bus of boards `fdc1004` on which some legs are ganged: rows all at ground, a conversion reads a column.

A foot in the air needs no elements, only the first sign of the ground. Ganged, each conversion sees three elements,
wherever on the foot the ground is met; the full legs go on with their elements in the same broadcast conversions.

    what        full legs                      ganged legs
    rows        the step's row, with the plan  all, once
    trigger     together                       together
    CAPDAC      off                            `CAPDAC` steps: three elements at rest are beyond the range without it
    reading     OK: the element                GANGED: the sum of its column, in the element's place

A leg changes sides between two conversions, never in one: it is left out of one trigger, gets its rows and its
converter's settings while the others convert, and joins the next trigger. What its place held stays as it was. After
any trouble that makes the scanner begin anew, every leg is full.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_interface import adg715
from firmware_interface.fdc1004 import CAPDAC_STEP_PF
from footsense.acquisition.boards import fdc1004
from footsense.acquisition.boards.board import switch_check
from footsense.acquisition.boards.conversion import Conversion, channels
from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.leg_connection import LegLink
from footsense.acquisition.scan_plan import Step
from footsense.errors import BusError
from footsense.frames import Reading
from footsense.ports import Transaction

#: Steps of the CAPDAC while ganged: 15.6 pF of the 16.2 pF of three elements at rest, so that 31 pF are in range, and
#: below the steps 8 and 16, where it is known to jump.
CAPDAC = 5

_COLUMNS_AT_ONCE = fdc1004.configuration(CAPDAC)
_ALL_ROWS = (Transaction(adg715.ADDRESS, bytes((adg715.ALL_LINES,))),)
_ROWS_CHECK = switch_check(_ALL_ROWS[0])
_SETTING_CHECK = fdc1004.setting_check(CAPDAC)


class GangedBusScanner(BusScanner):
    """The legs behind one mux; each is read element by element, or column by column if told so. See `BusScanner`."""

    _wanted: frozenset[int] = frozenset()
    _ganged: frozenset[LegLink] = frozenset()
    #: Left out of the trigger that was last: they are changing sides.
    _changing: tuple[LegLink, ...] = ()
    #: Have changed sides during the conversion that runs.
    _changed: tuple[LegLink, ...] = ()

    def gang(self, legs: Sequence[bool] | NDArray[np.bool_]) -> None:
        """Say which legs are to be ganged from the next conversions on.

        Args:
            legs: One entry a leg, in the order of the rows of the scans.
        """
        self._wanted = frozenset(np.flatnonzero(legs).tolist())

    @property
    def n_legs(self) -> int:
        """Return how many legs there are."""
        return len(self._legs)

    def _step(self) -> None:
        """As of `BusScanner`; then let the legs that were left out of the trigger change sides."""
        t_ns, capacitance_pf, reading = self._latest
        spared, element = self._changed, self._plan.steps[self._position].element
        at = [(self._legs.index(leg), element) for leg in spared]
        kept = [(t_ns[place], capacitance_pf[place], reading[place]) for place in at]
        self._ganged = frozenset(leg for leg in self._ganged if leg.in_scan)
        super()._step()
        for leg, place, before in zip(spared, at, kept, strict=True):
            if leg.outcome is Reading.OK:
                t_ns[place], capacitance_pf[place], reading[place] = before
        self._change_sides()

    def _change_sides(self) -> None:
        """Set up the legs that were left out of the trigger, all that go the same way at once."""
        running = self._running
        if running is None:  # nobody converted: all begin anew, and full
            self._changing = self._changed = ()
            return
        changing, self._changing = self._changing, ()
        self._changed = tuple(leg for leg in changing if leg.in_scan and leg.outcome is Reading.OK)
        ganging = tuple(leg for leg in self._changed if leg not in self._ganged)
        freed = tuple(leg for leg in self._changed if leg in self._ganged)
        # Until it has worked, a leg counts as ganged: whoever restores it then restores everything.
        self._ganged |= frozenset(ganging)
        self._set_up(ganging, _ALL_ROWS, _COLUMNS_AT_ONCE)
        self._ask_all(ganging, _ROWS_CHECK)
        self._ask_all(ganging, _SETTING_CHECK)
        self._set_up(freed, running.step.select, fdc1004.SINGLE_ELEMENTS)
        for check in (*running.step.select_checks, self._plan.board.setting_check):
            self._ask_all(freed, check)
        self._ganged -= frozenset(leg for leg in freed if leg.outcome is Reading.OK)

    def _set_up(
        self, legs: tuple[LegLink, ...], select: tuple[Transaction, ...], settings: Sequence[Transaction]
    ) -> None:
        if not legs:
            return
        try:
            self._trunk.connect(channels(legs))
            for transaction in (*select, *settings):
                self._trunk.bus.transfer(transaction)
        except BusError as error:
            self._look_for_holder(error)
            self._trunk.doubt()
            for leg in legs:
                leg.outcome = Reading.MISCONFIGURED

    def _active(self) -> tuple[LegLink, ...]:
        return tuple(leg for leg in super()._active() if leg not in self._changing)

    def _sides(self) -> tuple[tuple[LegLink, ...], tuple[LegLink, ...]]:
        """Return the active legs that are full, and those that are ganged."""
        active = self._active()
        return tuple(leg for leg in active if leg not in self._ganged), tuple(
            leg for leg in active if leg in self._ganged
        )

    def _prepare(self, following: Step) -> None:
        """Decide who changes sides, and connect those to whom the first write of the next conversion goes."""
        self._changing = tuple(
            leg
            for row, leg in enumerate(self._legs)
            if leg.in_scan and leg.outcome is Reading.OK and (row in self._wanted) != (leg in self._ganged)
        )
        full, ganged = self._sides()
        if not (ganged and full and following.changes):
            super()._prepare(following)
            return
        try:
            self._trunk.connect(channels(full))
        except BusError as error:
            self._look_for_holder(error)

    def _trigger(self, step: Step, legs: tuple[LegLink, ...], select: tuple[Transaction, ...]) -> None:
        full = tuple(leg for leg in legs if leg not in self._ganged)
        if len(full) == len(legs):
            super()._trigger(step, legs, select)
            return
        if select and full:
            self._trunk.connect(channels(full))
            for write in select:
                self._trunk.bus.transfer(write)
        self._trunk.connect(channels(legs))
        self._trunk.bus.transfer(step.trigger)

    def _all_done(self, conversion: Conversion) -> bool:
        """Ask those that converted and still take part: who has just changed sides did not, and would say no."""
        asked = tuple(leg for leg in self._active() if leg in conversion.legs)
        if not asked:
            return False
        if asked == self._active():
            return super()._all_done(conversion)
        try:
            self._trunk.connect(channels(asked))
            done = conversion.step.done
            return done is None or done.says(self._trunk.bus.transfer(done.ask)) is Reading.OK
        except BusError as error:
            self._look_for_holder(error)
            return False

    def _read_leg(self, leg: LegLink, step: Step, *, all_done: bool) -> tuple[Reading, float]:
        # A leg that is changing sides was not asked together with the others.
        reading, capacitance_pf = super()._read_leg(
            leg, step, all_done=all_done and leg not in self._changing
        )
        if reading is Reading.OK and leg in self._ganged:
            return Reading.GANGED, capacitance_pf + CAPDAC * CAPDAC_STEP_PF
        return reading, capacitance_pf

    def _check(self, conversion: Conversion) -> None:
        full, ganged = self._sides()
        if not ganged:
            super()._check(conversion)
            return
        if conversion.selected:
            for check in conversion.step.select_checks:
                self._ask_all(full, check)
            self._ask_all(ganged, _ROWS_CHECK)
        if conversion.step.setting_check is not None:
            self._ask_all(full, conversion.step.setting_check)
            self._ask_all(ganged, _SETTING_CHECK)

    def _restore(self, leg: LegLink) -> None:
        if leg in self._ganged:
            for write in fdc1004.SINGLE_ELEMENTS:
                self._trunk.bus.transfer(write)
            self._ganged -= {leg}

    def _set_afresh(self) -> None:
        """As of `BusScanner`; and everybody is full again, whose row the next conversion selects."""
        self._changing = self._changed = ()
        _, ganged = self._sides()
        self._set_up(ganged, self._plan.steps[0].select, fdc1004.SINGLE_ELEMENTS)
        self._ganged -= frozenset(leg for leg in ganged if leg.outcome is Reading.OK)
        super()._set_afresh()
