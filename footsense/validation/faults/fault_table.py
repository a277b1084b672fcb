"""Table of all faults: one walk each, with their appearance on CAN and effect on the other legs."""

from collections.abc import Callable
from itertools import islice

import msgspec
import numpy as np

from footsense.validation.faults.can_trial import CanFigures, can_trial
from footsense.validation.faults.fault_scripts import CAN_TRIALS, TRIALS
from footsense.validation.faults.fault_trial import LEG, FaultFigures, fault_figures
from footsense.validation.faults.published_walk import BREAKS_AT_S, WALK, PublishedWalk, walk

#: Length of a walk with a fault of CAN [s]: the kernel checks a carrier once a second, and the daemon opens the
#: interface again as often.
_CAN_WALK_S = 4.0
#: Step between the rows of the quick table.
_QUICK_STEP = 6


def fault_rows(report: Callable[[str], None], *, quick: bool = False) -> dict[str, FaultFigures]:
    """Walk without a fault, then with each fault of legs, buses and feet; return the figures by words.

    Args:
        report: Called with the words of each row as it is complete.
        quick: Whether only every sixth fault is walked.

    Raises:
        ModelError: The released network or the response table is missing.
    """
    whole = walk()
    found = {"nothing": _without_fault(whole)}
    for trial in islice(TRIALS, None, None, _QUICK_STEP if quick else 1):
        effects = msgspec.structs.replace(WALK.effects, adapter_timeout_ms=trial.adapter_timeout_ms)
        broken = walk(*trial.script, config=trial.config, effects=effects)
        found[trial.words] = fault_figures(broken, whole, BREAKS_AT_S, trial.until_s)
        report(trial.words)
    return found


def _without_fault(whole: PublishedWalk) -> FaultFigures:
    """Return the figures of a walk without a fault, with the leg's largest error over its sigma."""
    row = whole.legs.index(LEG)
    late = whole.t_sent_ns > BREAKS_AT_S * 1e9
    over_sigma = np.abs(whole.force_n - whole.true_force_n)[late, row] / whole.sigma_n[late, row]
    return fault_figures(whole, whole, BREAKS_AT_S, None)._replace(worst_error_sigma=float(over_sigma.max()))


def can_rows(report: Callable[[str], None], *, quick: bool = False) -> dict[str, CanFigures]:
    """Walk with each fault of CAN; return the figures by words. Arguments as of `fault_rows`."""
    found = {}
    for words, fault in islice(CAN_TRIALS.items(), None, None, _QUICK_STEP if quick else 1):
        found[words] = can_trial(fault, duration_s=_CAN_WALK_S)
        report(words)
    return found
