"""Markdown summary (card) of a calibrated foot: parameters and force errors, for people to read."""

from collections.abc import Sequence

import numpy as np

from footsense.foot.files.calibration_format import Manifest, Parameters


def card_text(manifest: Manifest, parameters: Parameters) -> str:
    """Return the summary of a calibrated foot as Markdown.

    Args:
        manifest: Its manifest; the hashes of the files are not used.
        parameters: Its parameters.
    """
    recordings = "\n".join(f"| {name} | `{sha256}` |" for name, sha256 in manifest.recordings.items())
    n_loads = _count_with_plural(manifest.n_loads, "load")
    n_sessions = _count_with_plural(manifest.n_sessions, "session")
    strayed = "stray capacitance, wiring of the test stand included [pF]"
    return f"""# {manifest.foot}

A foot of type {manifest.foot_type}, calibrated {manifest.made} by footsense {manifest.footsense}
on {n_loads} in {n_sessions}{_temperature_text(parameters)}. The
robot uses these files unchanged, or not at all: it detects and refuses every edit by hand.

## Errors

{_error_table(manifest)}

## How it differs from its design

| | front row on top, left column left | |
|---|---|---|
{_element_values_row("air gap [um]", parameters.gap_um, 2)}
{_element_values_row("reads unloaded [pF]", parameters.unloaded_pf, 3)}
{_element_values_row(strayed, parameters.stray_pf, 3)}
{_element_values_row("gain of the closure [1]", parameters.gain_rel, 3)}

Stiffness {parameters.stiffness_rel:+.1%}; mounted {_mount_angle_deg(parameters):.1f} deg off. Unexplained by the
calibration: {parameters.error_rel:.1%} of the force.

## Origin

Network `{parameters.network_sha256}`, training set `{manifest.recordings_sha256}`:

| recording | SHA-256 |
|---|---|
{recordings}
"""


def _count_with_plural(n: int, what: str) -> str:
    """Return a count with its noun as text, in the plural unless it is 1."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _temperature_text(parameters: Parameters) -> str:
    """Return the calibration temperature as a clause of text."""
    if parameters.temperature_c is None:
        return ", at an unknown temperature"
    return f", at {parameters.temperature_c:.1f} degC"


def _error_table(manifest: Manifest) -> str:
    held_out = manifest.held_out
    if held_out is None:
        return "Unknown: no load was held out."
    rows = [
        f"| {name} | {e.direction_deg:.2f} / {e.direction_p95_deg:.2f} / {e.direction_max_deg:.2f} | "
        f"{e.magnitude_gf:.2f} / {e.magnitude_p95_gf:.2f} / {e.magnitude_max_gf:.2f} |"
        for name, e in (
            ("network of the design alone", held_out.design_only),
            ("with this calibration", held_out.calibrated),
        )
    ]
    return f"""{held_out.protocol}, {_count_with_plural(held_out.calibrated.n, "load")}:

| mean / p95 / largest | direction [deg] | magnitude [gf] |
|---|---:|---:|
{chr(10).join(rows)}"""


def _element_values_row(what: str, values: Sequence[float], digits: int) -> str:
    """Return one row of a Markdown table with a value per element."""
    rows = [" ".join(f"{value:.{digits}f}" for value in values[i : i + 3]) for i in (0, 3, 6)]
    return f"| {what} | {'<br>'.join(rows)} | mean {np.mean(values):.{digits}f} |"


def _mount_angle_deg(parameters: Parameters) -> float:
    """Return the angle of the fitted mounting rotation [deg]."""
    return float(np.degrees(np.arccos(np.clip((np.trace(parameters.mount) - 1.0) / 2.0, -1.0, 1.0))))
