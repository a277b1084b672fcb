"""Live guidance of a calibration session, and the simulated scene for practice sessions."""

from collections.abc import Callable
from functools import partial
from zlib import crc32

import numpy as np

from footsense.calibration.evaluation import estimate_loads
from footsense.calibration.loads.load_set import LoadSet
from footsense.calibration.loads.press import CalibrationLoad
from footsense.calibration.session.checks import reference_findings
from footsense.calibration.session.guide import SessionGuide
from footsense.config.test_stand import StandConfig
from footsense.estimation.network import Network
from footsense.frames import Vector
from footsense.ports import LoadEstimate, Window
from footsense.sim.scene import Effects, Fabrication, Scene
from footsense.sim.scene_loads import CalibrationLoads
from footsense.sim.test_stand.press_sequence import paper_presses


def session_guide(
    test_stand: StandConfig, row: int, n_wanted: int, network: Network, report: Callable[[str], None]
) -> SessionGuide:
    """Return the observer that guides a calibration session, with force estimates by the foot type's network.

    Args:
        test_stand: Its force sensor.
        row: Row of the leg in the frames.
        n_wanted: Number of loads of a complete set.
        network: Network of the design, whose forces check those of the sensor.
        report: Takes each message, one line.
    """
    one_row = _SingleFootNetwork(network)

    def estimate(load: CalibrationLoad) -> Vector:
        estimates = estimate_loads(LoadSet.from_loads([load]), one_row, network.card.trained_inputs, None)
        force_n: Vector = estimates.force_n[0]
        return force_n

    return SessionGuide(row, n_wanted, estimate, partial(reference_findings, test_stand), report)


class _SingleFootNetwork:
    """Adapter that runs a network of several rows for a single foot: every row gets the same input."""

    def __init__(self, network: Network) -> None:
        self._network = network

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated load of the foot (the first row)."""
        return LoadEstimate(*(part[:1] for part in self._network.estimate(window)))


def practice_scene(foot: str, row: int, session: str) -> Scene:
    """Return a scene that presses a foot, with the paper's fabrication tolerances, 362 times in random order.

    Args:
        foot: Its identity: another foot is another specimen.
        row: Row of its leg in the frames.
        session: Name of the mounting: in another one the foot sits a little differently, and the order is another.
    """
    mounting = crc32(session.encode()) & 0xFFFF
    presses = paper_presses("training")
    presses = presses[np.random.default_rng(mounting).permutation(len(presses))]
    number = int(foot.rpartition("-")[2])
    return Scene(
        description=f"{foot} on the test stand, pressed as in the paper.",
        load=CalibrationLoads(
            presses=tuple((x, y, z) for x, y, z in presses.tolist()), lean_deg=1.0, seed=mounting
        ),
        lead_in_s=1.5,
        seed=mounting,
        host_cost_us=40.0,
        effects=Effects(converter_noise=True, converter_clock_rel=0.02, gap_contact=True, rubber=True),
        fabrication=Fabrication.with_paper_tolerances(seed=1, first=max(number - row, 0), mounting=mounting),
    )
