"""Windows of readings of one foot as the scans of several boards take them: the same loads, each at its own pace.

Loads at rest, the measured walk, a robot dog's trot, and random gaits; a gait has the same loads for every board. Gains
are exact.
"""

from typing import NamedTuple

import numpy as np

from footsense.estimation.missing_elements import MAX_OVERLOADED
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS, Leg, Vector
from footsense.lab.geometry import LoadRange
from footsense.lab.training.gait_readings import (
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    loads_of,
    simulate_gait_readings,
    simulate_random_gait_readings,
)
from footsense.lab.training.gait_windows import (
    readings_since,
    readings_since_table,
    windows_of,
)
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, random_loads
from footsense.lab.training.windowed_network import READINGS_PER_ELEMENT
from footsense.ports import Window
from footsense.sim.loads.ground_load import ContactSource
from footsense.sim.loads.walk import Walk, measured_walk, trot_reaction

#: A trot with the times of a Unitree Go1's: stride and stance [s], and times in which the force rises to 70 % [s].
TROT_STRIDE_S, TROT_STANCE_S = 0.67, 0.4
TROT_RISES_S: dict[Leg, float] = {"lf": 0.02, "rf": 0.04, "lr": 0.06, "rr": 0.08}
#: Force from which the errors in gaits count [N].
LOADED_N = 0.1
_WALKING_LEGS: tuple[Leg, ...] = ("rf", "lf")
_WALK_START_NS = 200_000_000
#: Duration of a walk and of a random gait [s].
_WALK_S, _GAIT_S = 6.8, 3.0


class BoardScan(NamedTuple):
    """What of a board's scan the readings of a foot depend on.

    Attributes:
        step_s: From one conversion to the next [s].
        send_delay_s: From the middle of a conversion to the sending of the force that ends with it [s].
        noise_pf: Noise of a conversion [pF, rms].
        range_end_pf: Largest capacitance that the converter reads [pF].
    """

    step_s: float
    send_delay_s: float
    noise_pf: float
    range_end_pf: float

    @property
    def mean_age_s(self) -> float:
        """Age of the newest readings of the elements at sending, mean over the elements [s]."""
        return self.send_delay_s + 0.5 * (ELEMENTS - 1) * self.step_s


class JudgedWindows(NamedTuple):
    """Windows of loaded feet, and how often there is none.

    Attributes:
        window: The n windows.
        force_n: True force at sending [N], shape (n, 3).
        without_force_rel: Share of the loads without a force, as too many elements are beyond the range [1].
    """

    window: Window
    force_n: Vector
    without_force_rel: float


def dog_trot(start_ns: int) -> Walk:
    """Return the trot of a robot dog of 1 N peak, which begins at a time [ns]."""
    return Walk(
        {
            leg: trot_reaction(TROT_STANCE_S / TROT_STRIDE_S, rise_s / TROT_STANCE_S, 1.0, 0.15)
            for leg, rise_s in TROT_RISES_S.items()
        },
        period_ns=round(1e9 * TROT_STRIDE_S),
        duty_rel=TROT_STANCE_S / TROT_STRIDE_S,
        pitch_deg=10.0,
        from_ns=start_ns,
    )


def judged_windows(
    response: FootResponse, loads: LoadRange, scan: BoardScan, seed: int, n_rests: int, n_gaits: int
) -> dict[str, JudgedWindows]:
    """Return the windows of a foot under every kind of load, by its name.

    Args:
        response: Response of the foot.
        loads: Its loads at rest and full load.
        scan: How the board reads it.
        seed: Seed of loads, gaits and noise.
        n_rests: Number of loads at rest.
        n_gaits: Number of random gaits.
    """
    random = []
    for number in range(n_gaits):
        rng = np.random.default_rng((seed, number))
        n = round(_GAIT_S / scan.step_s)
        random.append(simulate_random_gait_readings(response, rng, n, loads.max_n, _conditions(scan)))
    return {
        "rest": _at_rest(response, loads, scan, seed, n_rests),
        "walk": _of_gaits(
            _walked(response, scan, seed, measured_walk(1.0, 10.0, _WALK_START_NS), _WALKING_LEGS)
        ),
        "trot": _of_gaits(_walked(response, scan, seed, dog_trot(_WALK_START_NS), tuple(TROT_RISES_S))),
        "random": _of_gaits(random),
    }


def _conditions(scan: BoardScan) -> ReadingConditions:
    """Return the conditions of a gait that a board reads."""
    return ReadingConditions(**scan._asdict())


def _walked(
    response: FootResponse, scan: BoardScan, seed: int, source: ContactSource, legs: tuple[Leg, ...]
) -> list[GaitReadings]:
    """Return the readings of some legs of a walk."""
    return [
        simulate_gait_readings(
            response,
            loads_of(source, leg),
            _conditions(scan),
            np.random.default_rng((seed, row)),
            round(_WALK_S / scan.step_s),
        )
        for row, leg in enumerate(legs)
    ]


def _of_gaits(gaits: list[GaitReadings]) -> JudgedWindows:
    """Return the windows of gaits whose foot is loaded."""
    joined = concatenate_gaits(gaits)
    everything = windows_of(joined._replace(in_range=np.ones_like(joined.in_range)))
    n_loaded = int((np.linalg.norm(everything.force_n, axis=1) >= LOADED_N).sum())
    windows = windows_of(joined)
    loaded = np.linalg.norm(windows.force_n, axis=1) >= LOADED_N
    n = int(loaded.sum())
    window = Window(windows.closure_rel[loaded], windows.age_s[loaded], np.zeros((n, ELEMENTS), bool))
    return JudgedWindows(window, windows.force_n[loaded], 1.0 - n / n_loaded)


def _at_rest(
    response: FootResponse, loads: LoadRange, scan: BoardScan, seed: int, n_rests: int
) -> JudgedWindows:
    """Return windows of constant loads, each of whose readings has its own noise, at the end of a scan."""
    design, rng = response.design, np.random.default_rng(seed)
    cases = random_loads(response, loads, n_rests, seed)
    counted = np.linalg.norm(cases.force_n, axis=1) >= loads.min_evaluated_force_n
    force_n, exact_pf = cases.force_n[counted], design.capacitance_pf(cases.closure_um[counted])
    read_pf = exact_pf[:, None] + scan.noise_pf * rng.normal(
        size=(len(exact_pf), READINGS_PER_ELEMENT, ELEMENTS)
    )
    baseline_pf = design.unloaded_pf + BASELINE_NOISE_PF * rng.normal(size=(len(exact_pf), 1, ELEMENTS))
    closure_um = design.closure_um(np.minimum(read_pf, scan.range_end_pf), baseline_pf)
    since = readings_since(readings_since_table(), np.array([0]), np.array([ELEMENTS - 1]))
    age_s = since * scan.step_s + scan.send_delay_s
    told = (read_pf[:, 0] >= scan.range_end_pf).sum(axis=1) <= MAX_OVERLOADED
    n = int(told.sum())
    window = Window(
        closure_um[told] / design.gap_um, np.repeat(age_s, n, axis=0), np.zeros((n, ELEMENTS), bool)
    )
    return JudgedWindows(window, force_n[told], 1.0 - n / len(force_n))
