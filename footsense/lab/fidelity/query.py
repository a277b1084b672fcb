"""One load, one rung: what `footsense lab response` shows."""

from typing import Any

import numpy as np

from footsense.foot.directions import directions
from footsense.foot.response_table import FootResponse
from footsense.lab.fidelity.levels import rung
from footsense.lab.geometry import FootDesign

#: Largest contact patch that is answered, over the ball's radius [1]: Hertz takes it as small.
MOST_PATCH_REL = 0.3


def response_to(
    response: FootResponse,
    foot_design: FootDesign,
    direction_deg: tuple[float, float],
    force_n: float,
    name: str = "contact",
) -> dict[str, Any]:
    """Return what a centred load does to the elements, as JSON values.

    Args:
        response: The foot's response table.
        foot_design: The foot that the table is of.
        direction_deg: Azimuth and elevation (theta1, theta2) of the force [deg].
        force_n: Its magnitude [N].
        name: The rung.

    Returns:
        `rung`, `direction_deg`, `force_n`; `closure_um`, `capacitance_pf` (without stray) and `unloaded_pf` (unloaded);
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
    if not 0.0 <= direction_deg[1] <= 90.0:
        raise ValueError(f"an elevation is between 0 and 90 deg, got {direction_deg[1]:g}")
    normal = directions(*np.array(direction_deg)[:, None])
    patch_mm = float(response.patch_radius_mm(normal, force_n * normal)[0])
    if patch_mm > MOST_PATCH_REL * response.ball_radius_mm:
        raise ValueError(
            f"{force_n:g} N would flatten the ball over {patch_mm:.1f} mm; the models hold up to "
            f"{MOST_PATCH_REL * response.ball_radius_mm:g} mm"
        )
    found = rung(name, response, foot_design).answer(normal, force_n * normal)
    return {
        "rung": name,
        "direction_deg": list(direction_deg),
        "force_n": force_n,
        "closure_um": found.closure_um.reshape(3, 3).round(4).tolist(),
        "capacitance_pf": found.capacitance_pf.reshape(3, 3).round(5).tolist(),
        "unloaded_pf": round(response.design.unloaded_pf, 5),
    }
