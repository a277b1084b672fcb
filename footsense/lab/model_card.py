"""The README beside the released files: the files, how to make them, and the network's errors."""

from typing import Any

from footsense.foot.response_table import FootResponse
from footsense.lab.evaluation.evaluate import Errors
from footsense.lab.evaluation.evaluate_models import HELD_OUT_CASES, as_markdown
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.geometry import FootDesign


def readme(
    foot_design: FootDesign,
    response: FootResponse,
    card: dict[str, Any],
    table: dict[str, Errors],
    parity_n: float,
    *,
    quick: bool,
) -> str:
    """Return the model card for people."""
    where, loads, weights = response.provenance, foot_design.loads, card["training"]["weights"]
    span, lean = f"{loads.min_judged_n:g} to {loads.max_n:g} N", f"{loads.typical_lean_deg:g} deg"
    radius = f"{foot_design.ball_radius_mm:g} mm radius"
    noise = f"{1000 * card['training']['wide']['noise_pf']:g} fF"
    asymmetry, residual, cut_off = (
        f"{100 * where[key]:.4f} %" for key in ("mesh_asymmetry_rel", "fit_residual_rel", "interpolation_rel")
    )
    warning = "**A quick build: coarse mesh, short training. Not a release.**\n\n"
    return f"""# {response.foot_type}

{warning if quick else ""}{foot_design.about}: nine capacitors between two rubber hemispheres of {radius}.
`{FOOT_FILE}` describes it; everything else is made from that by one command, in the folder above this one, and nothing
is edited by hand:

    footsense lab build --foot {foot_design.foot_type}/{FOOT_FILE} --out .{" --quick" if quick else ""}

| file | what |
|---|---|
| `{FOOT_FILE}` | the foot: an element has {foot_design.capacitor.unloaded_pf:.2f} pF at rest |
| `network.onnx` | `closure_rel`, `missing` [n, 9] to `force_n`, `sigma_n` [n, 3]; {weights} weights; card inside |
| `response.npz` | the simulator's foot: contact normals above {response.min_elevation_deg:g} deg |

`paper_*`: the paper's 180 verification cases (100 gf, centred), no noise; read-outs fitted to the paper's 362 training
cases, but for `paper_network`, the network beside this page. `random_*`: {HELD_OUT_CASES} held-out random loads of
{span}, contact normals leaning from the force by {lean} rms sideways and along, at most
{loads.friction_angle_deg:g} deg, gaps closing in part, converter noise of {noise}.

{as_markdown(table)}

Largest difference between JAX and ONNX Runtime: {1000 * parity_n:.4f} mN. How far sigma holds, what a missing row
costs, and how near a network comes to the Cramer-Rao bound: `footsense lab study released` and `lab cramer-rao`; for
the released foot in `docs/report/README.md`.

Solid: a quarter in {where["elements"]} elements of order {where["mesh"]["order"]}, about {where["unknowns"]} unknowns
in each of three symmetry classes. x and y differ by {asymmetry} (rms, averaged out); the series differs from the
field's samples by {residual}, and from a series of four degrees less by {cut_off}.

Known limits: near the diagonals, far from upright, a light centred load is ambiguous: another load, its force far
aside and its contact leaning a little, closes all nine gaps alike, and no read-out of one scan tells them apart with
certainty. Near there a network also has its own largest errors. The studies `cramer-rao` and `error-map` measure both;
for the released foot they lie at about 44 deg and below about 50 gf.

Not modelled: large strain, creep, air trapped in the cavities.
"""
