"""A simulated test stand: one foot as made, pressed by a stick, recorded beside an exact reference."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footsense.can.interface import Can
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.foot_types import released_path
from footsense.daemon.loop import Loop
from footsense.daemon.service import open_service
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import ReferenceSamples, SensorStatistics
from footsense.sim.fabrication import draw_deviations
from footsense.sim.scene import Fabrication, Scene
from footsense.sim.scene_loads import CalibrationLoads

_SAMPLE_NS = 5_000_000

#: How badly the feet of these tests are made: enough that the network of the design alone errs by many degrees.
MADE = Fabrication(gap_um=3.0, stray_pf=0.1, stiffness_rel=0.08, mount_deg=4.0)

Felt = Callable[[int], NDArray[np.float64]]


class ExactReference:
    """A reference sensor that says what the foot feels, 200 times a second."""

    def __init__(self, true_force_n_at: Felt) -> None:
        self.statistics = SensorStatistics()
        self._true_force_n_at = true_force_n_at
        self._next_ns = 0

    def read(self, now_ns: int) -> ReferenceSamples:
        """Return the samples since the last call."""
        t_ns = np.arange(self._next_ns, now_ns + 1, _SAMPLE_NS)
        self._next_ns = int(t_ns[-1]) + _SAMPLE_NS if len(t_ns) else self._next_ns
        force_n = np.array([self._true_force_n_at(int(t))[0] for t in t_ns]).reshape(-1, 3)
        return ReferenceSamples(t_ns, force_n, np.zeros(len(t_ns), bool))

    def close(self) -> None:
        """Nothing is held."""


def presses(n: int, seed: int = 1) -> tuple[tuple[float, float, float], ...]:
    """Return forces of 0.4 to 1.2 N from all sides, shape (n, 3)."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(-np.pi, np.pi, n), np.radians(rng.uniform(50.0, 90.0, n))
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    force_n = rng.uniform(0.4, 1.2, n)[:, None] * direction
    return tuple((float(x), float(y), float(z)) for x, y, z in force_n)


def record(path: Path, foot: str = "foot-0007", n: int = 24, *, reference: bool = True) -> Path:
    """Record a session of `n` loads on the left front leg and return its file."""
    config = Config(
        buses=(Bus(device="sim", legs={"lf": 0}),), can=Can(interface="virtual"), feet={"lf": foot}
    )
    load = CalibrationLoads(presses=presses(n), rise_s=0.1, dwell_s=0.4, pause_s=0.4)
    scene = Scene(description="a test stand", load=load, fabrication=MADE)
    end_ns = load.build(round(scene.lead_in_s * 1e9)).end_ns + 200_000_000
    with open_service(config, scene, record=path, real_time=False) as service:
        true_force_n_at, clock = service.true_force_n_at, service.clock
        assert true_force_n_at is not None
        sensor = ExactReference(true_force_n_at) if reference else None
        loop = Loop(service.pipeline, service.sink, service.observers, clock, sensor)
        loop.run_until(service.source, lambda: clock.now_ns() >= end_ns)
    return path


def true_parameters(number: int = 0) -> FootParameters:
    """Return what a perfect calibration of the foot on a leg would find, by the leg's number."""
    response = FootResponse.load(released_path("response.npz"))
    made = draw_deviations(response, MADE.tolerances, MADE.seed, MADE.first + number)
    return FootParameters(
        stray_pf=made.stray_pf,
        unloaded_pf=Foot(response, made).unloaded_pf,
        gap_um=response.design.gap_um + made.gap_um,
        stiffness_rel=made.stiffness_rel,
        mount=made.mount,
    )
