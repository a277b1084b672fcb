"""Table of disturbances of the readings: what the forces of walking and of standing legs are then worth."""

from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np

from footsense.config import DEFAULT
from footsense.frames import IS_USABLE_STATE, Cause, State
from footsense.sim.faults import scene_faults as faults
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Effects, Scene, load_scene
from footsense.sim.scene_loads import Constant, Tripod
from footsense.validation.fault_trial import PublishedWalk, most_frequent_code, simulate_scene
from footsense.validation.known_feet import known_as_designed

#: Beginning of the disturbances, after the tare, with legs loaded and walking [s]; end of the scenes [s].
BEGINS_S, ENDS_S = 2.0, 6.0
#: Standard deviations within which errors have to be, and the share of them [1].
WANTED_SIGMAS, WANTED_WITHIN_REL = 2.0, 0.95

_EFFECTS = Effects(converter_noise=True, gap_contact=True)
#: Load of the standing legs [N].
STANDING_N = (0.05, 0.02, 0.6)


def scenes(max_n: float) -> dict[str, Scene]:
    """Return the scenes by name: a tripod, the measured walk, and standing.

    Args:
        max_n: Largest force of the feet [N]; the walks have half of it as their peak.
    """
    peak_n = 0.5 * max_n
    measured = load_scene("measured_walk")
    x, y, z = STANDING_N
    return {
        "tripod": Scene(
            description="Six legs walk.",
            load=Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=peak_n),
            lead_in_s=0.6,
            effects=_EFFECTS,
        ),
        "measured walk": msgspec.structs.replace(
            measured, load=msgspec.structs.replace(measured.load, peak_force_n=peak_n)
        ),
        "standing": Scene(
            description="Six legs stand.",
            load=Constant(force_n=(peak_n * x, peak_n * y, peak_n * z)),
            lead_in_s=0.8,
            effects=_EFFECTS,
        ),
    }


_SPAN: dict[str, Any] = {"at_s": BEGINS_S}
#: Disturbances by their words.
DISTURBANCES: dict[str, tuple[Fault, ...]] = {
    "nothing": (),
    "white noise, 5 fF": (faults.WhiteNoise(noise_ff=5.0, **_SPAN),),
    "white noise, 20 fF": (faults.WhiteNoise(noise_ff=20.0, **_SPAN),),
    "noise, 20 fF, 0.8 of it in common": (faults.WhiteNoise(noise_ff=20.0, common_rel=0.8, **_SPAN),),
    "tone of 61 Hz, 20 fF": (faults.Tone(amplitude_ff=20.0, frequency_hz=61.0, **_SPAN),),
    "tone of 7.3 Hz, 20 fF": (faults.Tone(amplitude_ff=20.0, frequency_hz=7.3, **_SPAN),),
    "tone of 40 Hz, 20 fF": (faults.Tone(amplitude_ff=20.0, frequency_hz=40.0, **_SPAN),),
    "noise bursts, 20 fF, 0.15 of each 0.5 s": (
        faults.NoiseBursts(noise_ff=20.0, period_s=0.5, active_s=0.15, **_SPAN),
    ),
    "impulses of 200 fF, one reading in 100": (faults.Impulses(amplitude_ff=200.0, rate_rel=0.01, **_SPAN),),
    "all nine shift by 50 fF": (faults.GroundShift(amplitude_ff=50.0, **_SPAN),),
    "all nine shift by -80 fF": (faults.GroundShift(amplitude_ff=-80.0, **_SPAN),),
    "a column shifts by 50 fF": (faults.ColumnShift(amplitude_ff=50.0, column=1, **_SPAN),),
    "a row shifts by 50 fF": (faults.RowShift(amplitude_ff=50.0, row=1, **_SPAN),),
    "wet tail, 50 fF": (faults.Leakage(amplitude_ff=50.0, **_SPAN),),
    "grounded metal 1 mm beside the tail": (faults.MetalBesideTail(**_SPAN),),
    "a column opens": tuple(
        faults.BrokenColumn(leg=leg, column=1, **_SPAN) for leg in ("lf", "lm", "lr", "rf", "rm", "rr")
    ),
    "channels shifted by one": (faults.ChannelsShifted(**_SPAN),),
}


class DisturbanceFigures(NamedTuple):
    """Forces of six legs from the beginning of a disturbance on.

    Attributes:
        error_n: Error of the usable forces, rms of its length [N].
        within: Share of the errors of their components within `WANTED_SIGMAS` [1].
        sigma_n: Median of their standard deviations [N].
        usable: Share of the forces that may be used [1].
        state: Most frequent state.
        cause: Most frequent cause.
    """

    error_n: float
    within: float
    sigma_n: float
    usable: float
    state: State
    cause: Cause


def figures(walk: PublishedWalk) -> DisturbanceFigures:
    """Return the figures of a walk with a disturbance from `BEGINS_S` on."""
    disturbed = walk.t_sent_ns > BEGINS_S * 1e9
    usable = IS_USABLE_STATE[walk.state] & disturbed[:, None]
    error_n = walk.force_n[usable] - walk.true_force_n[usable]
    sigma_n = walk.sigma_n[usable]
    return DisturbanceFigures(
        error_n=float(np.sqrt(np.square(error_n).sum(axis=1).mean())),
        within=float((np.abs(error_n) < WANTED_SIGMAS * sigma_n).mean()),
        sigma_n=float(np.median(sigma_n)),
        usable=float(usable[disturbed].mean()),
        state=State(most_frequent_code(walk.state[disturbed].ravel(), State.VALID)),
        cause=Cause(most_frequent_code(walk.cause[disturbed].ravel(), Cause.NONE)),
    )


def simulate_disturbances(
    report: Callable[[str], None],
    *,
    quick: bool = False,
    foot_type: str = DEFAULT.foot_type,
    max_n: float = 2.0,
) -> dict[str, dict[str, DisturbanceFigures]]:
    """Simulate each disturbance in each scene; return the figures by disturbance and scene.

    The feet are calibrated: what nobody knows of a foot would cover nearly all of them.

    Args:
        report: Called with the words of each row as it is complete.
        quick: Whether only the first three are simulated, standing.
        foot_type: The feet, as in a configuration.
        max_n: Their largest force [N].

    Raises:
        ModelError: The feet's network or response table is missing.
    """
    robot = msgspec.structs.replace(DEFAULT, foot_type=foot_type)
    chosen = scenes(max_n)
    rows = list(DISTURBANCES.items())
    if quick:
        chosen, rows = {"standing": chosen["standing"]}, rows[:3]
    found: dict[str, dict[str, DisturbanceFigures]] = {}
    for words, script in rows:
        found[words] = {}
        for name, scene in chosen.items():
            # Anew for each, as sigma grows with the age of a calibration.
            with known_as_designed(robot) as known:
                disturbed = msgspec.structs.replace(scene, faults=script)
                found[words][name] = figures(simulate_scene(disturbed, known, ENDS_S))
        report(words)
    return found
