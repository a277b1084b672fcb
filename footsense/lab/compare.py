"""Whether two builds are the same release: the largest differences beside what is tolerated.

The solve repeats to rounding, so the response must. Training in float32 over 10^5 steps amplifies the last bit of
its input and of another processor's arithmetic; what must repeat is how good the network is.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from footsense.lab.evaluate_models import evaluate_models, open_models
from footsense.lab.response import disc_normals

#: Response: largest difference over the largest value.
RESPONSE_REL = 1e-6
#: Network, on the paper's verification cases: difference of the mean errors [deg], [gf].
DIRECTION_DEG, MAGNITUDE_GF = 0.15, 0.2


@dataclass(frozen=True, slots=True)
class Difference:
    """One compared figure.

    Attributes:
        what: Its name and unit.
        found: Difference between the builds.
        tolerated: Largest one that is the same release.
    """

    what: str
    found: float
    tolerated: float

    @property
    def same(self) -> bool:
        """Whether the difference is tolerated."""
        return self.found <= self.tolerated


def compare(first: Path, second: Path) -> list[Difference]:
    """Return the differences between two folders of released files."""
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
        Difference(
            "network, mean direction error [deg]",
            abs(rows[0].direction_deg - rows[1].direction_deg),
            DIRECTION_DEG,
        ),
        Difference(
            "network, mean magnitude error [gf]",
            abs(rows[0].magnitude_gf - rows[1].magnitude_gf),
            MAGNITUDE_GF,
        ),
    ]
