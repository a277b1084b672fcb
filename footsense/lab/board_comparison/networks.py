"""Training of a network of some size, and its errors at the scans of boards."""

import tempfile
from pathlib import Path
from typing import NamedTuple

from footsense.estimation.missing_elements import Imputation
from footsense.foot.directions import angles_between_deg
from footsense.foot.network_card import NETWORK_FILE, add_checksum
from footsense.foot.response_table import FootResponse
from footsense.lab.board_comparison.windows import JudgedWindows
from footsense.lab.training.export import OnnxNetwork, onnx_model
from footsense.lab.training.gait_readings import GaitReadings
from footsense.lab.training.gait_windows import estimate_in_batches
from footsense.lab.training.load_cases import LeaningCases
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.windowed_network import mean_closure_product_matrix


class NetworkSubject(NamedTuple):
    """What networks are trained with and judged by.

    Attributes:
        response: Response of the foot.
        gaits: Gaits of the training.
        rests: Loads at rest of the training.
        tests: Windows by load and board.
        released: The released network.
        min_force_n: Force below which errors count absolutely [N].
    """

    response: FootResponse
    gaits: GaitReadings
    rests: LeaningCases
    tests: dict[str, dict[str, JudgedWindows]]
    released: Path
    min_force_n: float


class JudgedNetwork(NamedTuple):
    """A network's file, number of weights, and mean direction error [deg] by board and load."""

    file: bytes
    n_weights: int
    direction_deg: dict[str, dict[str, float]]


def train_and_judge(subject: NetworkSubject, steps: int, part: tuple[int | None, int]) -> JudgedNetwork:
    """Return a network, and its errors.

    Args:
        subject: What it is trained with and judged by.
        steps: Steps of the training.
        part: Channels (None for the released network) and seed.
    """
    channels, seed = part
    file, card = subject.released.read_bytes(), OnnxNetwork(subject.released).card
    n_weights = card["training"]["weights"]
    if channels is not None:
        design = subject.response.design
        moments = mean_closure_product_matrix(
            subject.rests.with_symmetric_copies().closure_um / design.gap_um
        )
        settings = WindowTrainingSettings(
            channels=channels, steps=steps, seed=seed, min_force_n=subject.min_force_n
        )
        weights = train_windowed(subject.gaits, subject.rests, design, settings, Imputation(moments))
        file, n_weights = add_checksum(onnx_model(weights, card).SerializeToString()), weights.n_weights
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / NETWORK_FILE
        path.write_bytes(file)
        network = OnnxNetwork(path)
    errors = {
        key: {
            load: float(
                angles_between_deg(estimate_in_batches(network, test.window).force_n, test.force_n).mean()
            )
            for load, test in tests.items()
        }
        for key, tests in subject.tests.items()
    }
    return JudgedNetwork(file, n_weights, errors)
