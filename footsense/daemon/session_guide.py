"""What holds a session's reference against its foot, and the practice session of a simulated bench."""

from collections.abc import Callable
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.evaluation import read_loads
from footsense.calibration.loads.detection import CalibrationLoad
from footsense.calibration.session.guide import Guide
from footsense.calibration.session.reference_judge import judge_of
from footsense.config.test_stand import StandConfig
from footsense.estimation.network import Network
from footsense.sim.scene import CalibrationLoads, Effects, Fabrication, Scene
from footsense.sim.test_stand.calibration_loads import paper_presses

__all__ = ["guide_of", "practice_scene"]

Vector = NDArray[np.float64]


def guide_of(test_stand: StandConfig, row: int, wanted: int, network: Network) -> Guide:
    """Return what guides a session.

    Args:
        test_stand: Its force sensor.
        row: Row of the leg in the frames.
        wanted: How many loads make a set.
        network: That of the design: its forces tell whether those of the sensor may be right.
    """
    return Guide(row, wanted, _estimate_of(network), judge_of(test_stand))


def _estimate_of(network: Network) -> Callable[[CalibrationLoad], Vector]:
    one = _OneRow(network)

    def estimate(load: CalibrationLoad) -> Vector:
        force_n: Vector = read_loads([load], one, network.card.trained_inputs, None).force_n[0]
        return force_n

    return estimate


class _OneRow:
    """A network for all legs, asked for one foot: every row is given the same."""

    def __init__(self, network: Network) -> None:
        self._network = network

    def estimate(self, closure_rel: Vector, missing: NDArray[np.bool_]) -> tuple[Vector, Vector]:
        force_n, sigma_n = self._network.estimate(closure_rel, missing)
        return force_n[:1], sigma_n[:1]


def practice_scene(foot: str, row: int, session: str) -> Scene:
    """Return a bench on which a foot that is made as badly as the paper's is pressed 362 times, in a mixed order.

    Args:
        foot: Its identity: another foot is another specimen.
        row: Row of the leg that it is on.
        session: Name of the mounting: in another one the foot sits a little differently, and is pressed otherwise.
    """
    mounting = crc32(session.encode()) & 0xFFFF
    presses = paper_presses("training")
    presses = presses[np.random.default_rng(mounting).permutation(len(presses))]
    number = int(foot.rpartition("-")[2])
    return Scene(
        description=f"{foot} on the test_stand, pressed as in the paper.",
        load=CalibrationLoads(
            presses=tuple((float(x), float(y), float(z)) for x, y, z in presses), lean_deg=1.0, seed=mounting
        ),
        lead_in_s=1.5,
        seed=mounting,
        host_cost_us=40.0,
        effects=Effects(converter_noise=True, converter_clock_rel=0.02, gap_contact=True, rubber=True),
        fabrication=Fabrication.as_badly_made(seed=1, first=max(number - row, 0), mounting=mounting),
    )
