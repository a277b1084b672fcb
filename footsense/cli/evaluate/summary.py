"""Results of `footsense evaluate` as plain values and as a text table."""

from collections.abc import Sequence
from typing import Any

from footsense.calibration.evaluation import MAGNITUDE_BANDS, Evaluation, MagnitudeBand
from footsense.calibration.session.recorded_session import RecordedSession
from footsense.foot.files.calibration_reader import FootCalibration
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors


def evaluation_results(
    foot: str,
    foot_type: str,
    sessions: Sequence[RecordedSession],
    calibration: FootCalibration | None,
    evaluation: Evaluation,
) -> dict[str, Any]:
    """Return all results of an evaluation as plain values; bands without loads are left out."""
    ways = evaluation.estimates
    bands = {band.name: _band_errors(evaluation, band) for band in MAGNITUDE_BANDS}
    kept = ("made", "footsense", "n_loads", "sha256")
    return {
        "foot": foot,
        "foot_type": foot_type,
        "calibration": calibration and {key: getattr(calibration.manifest, key) for key in kept},
        "sessions": {session.name: len(session.loads) for session in sessions},
        "n_loads": len(evaluation.reference_n),
        "n_compared": int(evaluation.is_compared.sum()),
        "outside_training_range": {way: int((~estimates.has_force).sum()) for way, estimates in ways.items()},
        "bands": {name: errors for name, errors in bands.items() if errors},
    }


def _band_errors(evaluation: Evaluation, band: MagnitudeBand) -> dict[str, dict[str, float]]:
    """Return the force errors of the loads of a band, by estimator; empty without loads."""
    found = {way: evaluation.errors_of(estimates, band) for way, estimates in evaluation.estimates.items()}
    return {way: _error_values(errors) for way, errors in found.items() if errors is not None}


def _error_values(errors: ForceErrors) -> dict[str, float]:
    """Return force errors as plain values."""
    return {
        "loads": errors.n,
        "direction_deg": errors.direction_deg,
        "direction_p95_deg": errors.direction_p95_deg,
        "magnitude_gf": errors.magnitude_gf,
        "magnitude_p95_gf": errors.magnitude_p95_gf,
        "magnitude_n": errors.magnitude_gf * GRAM_FORCE_N,
        "magnitude_p95_n": errors.magnitude_p95_gf * GRAM_FORCE_N,
    }


def error_table_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Return the rows of the table of force errors, its header first."""
    rows = [["magnitude", "forces by the", "loads", "deg", "p95", "gf", "p95", "N", "p95"]]
    for band, of_way in figures["bands"].items():
        for number, (way, errors) in enumerate(of_way.items()):
            n, *values = errors.values()
            cells = [f"{value:.{digits}f}" for value, digits in zip(values, (2, 2, 2, 2, 4, 4), strict=True)]
            rows.append([band if number == 0 else "", way, str(n), *cells])
    return rows


def headline_text(figures: dict[str, Any]) -> str:
    """Return foot, calibration and number of loads as one line of text."""
    calibration = figures["calibration"]
    by = "no calibration"
    if calibration:
        by = f"its calibration of {calibration['made']} on {calibration['n_loads']} loads"
    n_sessions = len(figures["sessions"])
    return (
        f"{figures['foot']}, type {figures['foot_type']}, {by}: {figures['n_compared']} of {figures['n_loads']} loads "
        f"in {n_sessions} session{'s' * (n_sessions > 1)} compared"
    )


def summary_text(figures: dict[str, Any]) -> str:
    """Return the headline and the table of force errors as text."""
    rows = error_table_rows(figures)
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([headline_text(figures), *lines])
