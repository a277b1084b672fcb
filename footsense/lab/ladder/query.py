"""One load, one rung: what `footsense lab response` shows."""

from typing import Any

import numpy as np

from footsense.lab.dataset import directions
from footsense.lab.geometry import SoleDesign
from footsense.lab.ladder.rungs import rung
from footsense.sim.foot import FootResponse


def response_to(
    response: FootResponse,
    sole: SoleDesign,
    direction_deg: tuple[float, float],
    force_n: float,
    name: str = "contact",
) -> dict[str, Any]:
    """Return what a centred load does to the elements, as JSON values.

    Args:
        response: The foot's response table.
        sole: The foot that the table is of.
        direction_deg: Azimuth and elevation (theta1, theta2) of the force [deg].
        force_n: Its magnitude [N].
        name: The rung.

    Returns:
        `rung`, `direction_deg`, `force_n`; `closure_um`, `capacitance_pf` (without stray) and `rest_pf` (unloaded);
        the first two as 3 x 3 lists, row 0 the most forward, column 0 the leftmost.

    Raises:
        ValueError: There is no such rung, it cannot answer for such a load, or the force is not above 0.
    """
    if not (np.isfinite(force_n) and force_n > 0.0):
        raise ValueError(f"a contact presses with more than 0 N, got {force_n:g}")
    if not np.isfinite(direction_deg).all():
        raise ValueError(
            f"a direction is two finite angles, got {direction_deg[0]:g}, {direction_deg[1]:g} deg"
        )
    normal = directions(*np.array(direction_deg)[:, None])
    found = rung(name, response, sole).answer(normal, force_n * normal)
    return {
        "rung": name,
        "direction_deg": list(direction_deg),
        "force_n": force_n,
        "closure_um": found.closure_um.reshape(3, 3).round(4).tolist(),
        "capacitance_pf": found.capacitance_pf.reshape(3, 3).round(5).tolist(),
        "rest_pf": round(response.design.rest_pf, 5),
    }
