"""The page beside the released files that tells people what they are and how good."""

from typing import Any

from footsense.lab.evaluate import Errors
from footsense.lab.evaluate_models import HELD_OUT_CASES, as_markdown
from footsense.sim.foot import FootResponse


def readme(response: FootResponse, card: dict[str, Any], table: dict[str, Errors], parity_n: float) -> str:
    """Return the model card for people."""
    where = response.provenance
    wide, weights = card["training"]["wide"], card["training"]["weights"]
    lean = f"{wide['typical_lean_deg']:g} deg"
    asymmetry, residual, cut_off = (
        f"{100 * where[key]:.4f} %" for key in ("mesh_asymmetry_rel", "fit_residual_rel", "interpolation_rel")
    )
    return f"""# {response.foot_type}

The soft foot of Aoyagi et al.: nine capacitors between two rubber hemispheres of {response.ball_radius_mm:g} mm
radius. Everything here is made by one command and nothing is edited by hand:

    footsense lab build --output models/{response.foot_type}

| file | what |
|---|---|
| `network.onnx` | `closure_rel`, `missing` [n, 9] to `force_n`, `sigma_n` [n, 3]; {weights} weights; card inside |
| `response.npz` | the simulator's foot: contact normals above {response.min_elevation_deg:g} deg |

`paper_*`: the paper's 180 verification cases (100 gf, centred), no noise; read-outs fitted to the paper's 362 training
cases, but for `paper_network`, the released one. `wide_*`: {HELD_OUT_CASES} held-out random loads, those from 0.2 N,
contact normals leaning from the force by {lean} rms sideways and along, {wide["friction_angle_deg"]:g} deg at most,
gaps shutting in part, converter noise of {1000 * wide["noise_pf"]:g} fF.

{as_markdown(table)}

Largest difference between JAX and ONNX Runtime: {1000 * parity_n:.4f} mN. How far sigma holds, what a missing row
costs, and how near this comes to the Cramer-Rao bound: `docs/report/README.md`.

Solid: a quarter in {where["elements"]} elements of order {where["mesh"]["order"]}, about {where["unknowns"]} unknowns
in each of three symmetry classes. x and y differ by {asymmetry} (rms, averaged out); the series differs from the
field's samples by {residual}, and from a series of four degrees less by {cut_off}.

Known limits: near the diagonals, at about 44 deg, a light centred load has a twin, its force far aside and its contact
leaning a little, that closes all nine gaps alike: below about 50 gf no read-out of one scan tells them apart for
certain. Near there this network also has its own largest errors. Both are measured in the studies `limit` and
`error-map` of `docs/report/README.md`.

Not modelled: large strain, creep, air trapped in the cavities.
"""
