"""Whether a build is as good as the release: what differs beside what is tolerated.

The solve repeats to rounding, so the response must. Training in float32 over 10^5 steps amplifies the last bit of
its input and of another processor's arithmetic; what must repeat is that the network is no worse.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from footsense.lab.evaluate_models import evaluate_models, open_models
from footsense.lab.response import disc_normals

#: Response: largest difference over the largest value.
RESPONSE_REL = 1e-6
#: Network, on the paper's verification cases: growth of the mean errors over those of the release [1]. Equal machines
#: give equal bytes; on other processors the mean direction error was 0.12 to 0.19 deg, and the release's 0.19 is the
#: worst of them. So an honest build hardly exceeds it, and one that is worse by 30 % has lost something.
WORSE_REL = 0.2


@dataclass(frozen=True, slots=True)
class Difference:
    """One compared figure.

    Attributes:
        what: Its name and unit.
        found: Difference between the builds; of an error, its growth, below zero where the second is better.
        tolerated: Largest one that is the same release.
    """

    what: str
    found: float
    tolerated: float

    @property
    def same(self) -> bool:
        """Whether the difference is tolerated."""
        return self.found <= self.tolerated


def growth(what: str, released: float, built: float) -> Difference:
    """Return by how much an error has grown.

    Example:
        >>> growth("error", 0.19, 0.12).same, growth("error", 0.19, 0.19 * 1.3).same
        (True, False)
    """
    return Difference(what, built / released - 1.0, WORSE_REL)


def compare(first: Path, second: Path) -> list[Difference]:
    """Return how the files in the second folder differ from the released ones in the first."""
    one, two = open_models(first)[0], open_models(second)[0]
    normal = disc_normals(max(one.min_elevation_deg, two.min_elevation_deg))
    closures = [response.closure_um(normal, normal) for response in (one, two)]
    rows = [evaluate_models(folder)["paper_network"] for folder in (first, second)]
    return [
        Difference(
            "response, largest over largest",
            float(np.abs(closures[0] - closures[1]).max() / np.abs(closures[0]).max()),
            RESPONSE_REL,
        ),
        growth("network, mean direction error, growth", rows[0].direction_deg, rows[1].direction_deg),
        growth("network, mean magnitude error, growth", rows[0].magnitude_gf, rows[1].magnitude_gf),
    ]
