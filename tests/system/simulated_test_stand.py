"""A simulated test stand: one foot as made, pressed by a stick, recorded beside a simulated force sensor."""

from pathlib import Path

import numpy as np

from footsense.can.interface import Can
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.config.test_stand import Axes, SimulatedSensor, StandConfig
from footsense.daemon.foot_types import released_path
from footsense.daemon.service import open_service
from footsense.daemon.test_stand import StandSession
from footsense.estimation.settings import TareLimits
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.sim.fabrication import draw_deviations
from footsense.sim.scene import Fabrication, Scene
from footsense.sim.scene_loads import CalibrationLoads

#: How badly the feet of these tests are made: enough that the network of the design alone errs by many degrees.
MADE = Fabrication(gap_um=3.0, stray_pf=0.1, stiffness_rel=0.08, mount_deg=4.0)

STAND = StandConfig(
    sensor=SimulatedSensor(seed=1, linearity_rel=0.0),
    axes=Axes(x="-x", y="-y", z="-z"),
    units="gf",
    rated=(4000.0, 4000.0, 8000.0),
    latency_ms=2.1,
)


def presses(n: int, seed: int = 1) -> tuple[tuple[float, float, float], ...]:
    """Return forces of 0.4 to 1.2 N from all sides, shape (n, 3)."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(-np.pi, np.pi, n), np.radians(rng.uniform(50.0, 90.0, n))
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    force_n = rng.uniform(0.4, 1.2, n)[:, None] * direction
    return tuple((float(x), float(y), float(z)) for x, y, z in force_n)


def record(path: Path, n: int = 24, *, reference: bool = True, temperature_c: float | None = None) -> Path:
    """Record a session of `n` loads on the left front leg, foot-0007, and return its file."""
    config = Config(
        buses=(Bus(device="sim", legs={"lf": 0}),),
        can=Can(interface="virtual"),
        feet={"lf": "foot-0007"},
        tare=TareLimits(unloaded_limit_rel=0.5),
    )
    load = CalibrationLoads(presses=presses(n), rise_s=0.1, dwell_s=0.4, pause_s=0.4)
    scene = Scene(description="a test stand", load=load, lead_in_s=2.0, fabrication=MADE)
    end_ns = load.build(round(scene.lead_in_s * 1e9)).end_ns + 500_000_000
    session = StandSession(test_stand=STAND, leg="lf", foot="foot-0007", session="one") if reference else None
    with open_service(config, scene, record=path, real_time=False, test_stand=session) as service:
        if temperature_c is not None:
            service.temperature_c = lambda: np.array([temperature_c])
        service.run(until_ns=end_ns)
    return path


def true_parameters(number: int = 0) -> FootParameters:
    """Return what a perfect calibration of the foot on a leg would find, by the leg's number."""
    response = FootResponse.load(released_path("response.npz"))
    made = draw_deviations(response, MADE.tolerances, MADE.seed, MADE.first + number)
    return FootParameters(
        stray_pf=made.stray_pf,
        unloaded_pf=Specimen(response, made).unloaded_pf,
        gap_um=response.design.gap_um + made.gap_um,
        stiffness_rel=made.stiffness_rel,
        mount=made.mount,
    )
