"""What sigma says of feet as they are made: how many errors are within it, through the service's pipeline."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.estimation.pipeline import pipeline_of
from footsense.estimation.settings import EstimationLimits, MountedFeet
from footsense.foot.specimen import Specimen
from footsense.frames import IS_USABLE_STATE, Vector
from footsense.lab.evaluation.walker_runs import LEAD_IN_S, SCAN_TIMES, WalkerLoads, read_walker, run_pipeline
from footsense.lab.report import Values
from footsense.lab.studies.boards.many_feet import foot_loads, smooth_tripod
from footsense.lab.studies.boards.walking_electrodes import walked_logs, walked_parameters
from footsense.sim.fabrication import PAPER_TOLERANCES, draw_deviations, uncertainty_of_parameters
from footsense.sim.uncalibrated import uncertainty_by_wear, uncertainty_of_uncalibrated
from footsense.validation.made_feet import SEED, MadeFootPlan, calibrate_made_foot

if TYPE_CHECKING:
    from footsense.foot.parameters import FootParameters

#: Least true force that counts, over the foot's largest [1]; peak of the loads over it, and of a foot that stands.
_LEAST_REL, _PEAK_REL, _STANDING_REL = 0.05, 0.5, 0.35
#: Time that a foot walks to find its electrodes [s].
_WALK_S = 60.0
#: Times of the judged loads, and of the rise of the standing foot [s]; its lean, tangential over normal [1, rms].
_TRIPOD_S, _STANDING_S, _RISE_S, _LEAN = 4.5, 4.0, 0.3, 0.15
_SAMPLING_S = 1e-3
NOT, STOOD, WALKED, PRESSED = "not calibrated", "by standing", "by walking for a minute", "pressed"


def sigma_of_made_foot(
    folder: Path, plan: MadeFootPlan, max_n: float, number: int, *, walks: bool
) -> list[Values]:
    """Return errors and sigma of a made foot, by calibration, board and load.

    Args:
        folder: Folder of its type.
        plan: Of the calibrations.
        max_n: Largest force of the foot [N].
        number: Number of the foot.
        walks: Whether it finds its electrodes by walking, too.

    Returns:
        Rows of `calibration`, `board`, `load`, `within` two sigma, each axis, `beyond` five of all components, and
        mean squares of error and sigma, `error_n2` and `sigma_n2`, each axis; none without a force.
    """
    models = DesignModels.load(folder)
    response, network = models.response, models.network_for_rows(1)
    foot = Specimen(response, draw_deviations(response, PAPER_TOLERANCES, SEED, number))
    pressed, stood = calibrate_made_foot(models, plan, number)
    known: dict[str, FootParameters | None] = {NOT: None, STOOD: stood, PRESSED: pressed}
    if walks:
        known[WALKED] = walked_parameters(models, walked_logs(), number, _WALK_S, _PEAK_REL * max_n)
    wear = uncertainty_by_wear(network, response, 1)
    rows = []
    for calibration, own in known.items():
        unknown = (
            uncertainty_of_uncalibrated(network, response, 1)
            if own is None
            else uncertainty_of_parameters(own, wear, pressed=calibration == PRESSED)
        )
        mounted = MountedFeet.of(response.design, [own], reading_pf=foot.unloaded_pf, uncertainty=[unknown])
        for board, scan in SCAN_TIMES.items():
            limits = EstimationLimits(scan_ns=scan.scan_ns, range_end_pf=scan.range_end_pf)
            for load, loads in _loads(max_n, number).items():
                outputs = run_pipeline(
                    pipeline_of(network, mounted, limits, response),
                    read_walker(foot, loads, number, scan=scan),
                )
                true_n = outputs.true.force_n[:, 0]
                counted = np.linalg.norm(true_n, axis=1) > _LEAST_REL * max_n
                counted &= IS_USABLE_STATE[outputs.state[:, 0]]
                if not counted.any():
                    continue
                error_n, sigma_n = outputs.force_n[counted, 0] - true_n[counted], outputs.sigma_n[counted, 0]
                off = np.abs(error_n) / sigma_n
                rows.append(
                    {
                        "calibration": calibration,
                        "board": board,
                        "load": load,
                        "within": (off < 2.0).mean(axis=0),
                        "beyond": (off > 5.0).mean(),
                        "error_n2": (error_n**2).mean(axis=0),
                        "sigma_n2": (sigma_n**2).mean(axis=0),
                    }
                )
    return rows


def _loads(max_n: float, number: int) -> dict[str, WalkerLoads]:
    """Return the loads of one foot by name: a tripod, and a foot that stands, leaning as its number says."""
    walk = smooth_tripod(_PEAK_REL * max_n, round(1e9 * LEAD_IN_S))
    t_s: Vector = np.asarray(_SAMPLING_S * np.arange(round(_STANDING_S / _SAMPLING_S)), np.float64)
    lean = _LEAN * np.random.default_rng((SEED, number, 7)).normal(size=2)
    share = np.clip((t_s - LEAD_IN_S - _RISE_S) / _RISE_S, 0.0, 1.0)
    force_n = (_STANDING_REL * max_n * share * share * (3.0 - 2.0 * share))[:, None, None] * [*lean, 1.0]
    normal = np.array([*lean / 2.0, 1.0])
    towards = np.broadcast_to(normal / np.linalg.norm(normal), force_n.shape)
    standing = WalkerLoads.of_still_feet(t_s, force_n, towards)
    return {"tripod": foot_loads([partial(walk.contact, "rf")], _TRIPOD_S), "standing": standing}


def sigma_rows(feet: Sequence[Sequence[Values]]) -> list[tuple[str, ...]]:
    """Return the cells of the figures of made feet by calibration, of `sigma_of_made_foot`: the worst of all loads."""
    rows: list[tuple[str, ...]] = []
    for calibration in (NOT, STOOD, WALKED, PRESSED):
        own = [row for foot in feet for row in foot if row["calibration"] == calibration]
        if not own:
            continue
        by_case: dict[tuple[str, str], list[Values]] = {}
        for row in own:
            by_case.setdefault((row["board"], row["load"]), []).append(row)
        within = [np.mean([row["within"] for row in rows_of], axis=0) for rows_of in by_case.values()]
        ratio = [
            np.sqrt(
                np.mean([r["sigma_n2"] for r in rows_of], axis=0)
                / np.mean([r["error_n2"] for r in rows_of], axis=0)
            )
            for rows_of in by_case.values()
        ]
        rows.append(
            (
                calibration,
                f"{np.min(within):.0%}",
                f"{min(np.mean(row['within']) for row in own):.0%}",
                f"{max(np.mean([row['beyond'] for row in rows_of]) for rows_of in by_case.values()):.1%}",
                f"{np.min(ratio):.1f} to {np.max(ratio):.1f}",
            )
        )
    return rows
