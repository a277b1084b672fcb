"""Figure of the probed feet's elements; needs matplotlib."""

from pathlib import Path

import numpy as np

from footsense.cli.probe.picture import element_marks
from footsense.daemon.probe.report import ProbeResult
from footsense.errors import FootsenseError
from footsense.frames import ROWS

_FEET_PER_ROW = 3


def draw_probed_feet(result: ProbeResult, title: str, file: Path) -> None:
    """Write a figure of every foot's elements, coloured by their deviation from the foot's median.

    Raises:
        FootsenseError: matplotlib is not installed, or the file cannot be written in the format of its suffix.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise FootsenseError("--png needs matplotlib: pip install 'footsense[lab]'") from error
    n_rows = -(-len(result.legs) // _FEET_PER_ROW)
    figure = Figure(figsize=(9.0, 0.8 + 2.9 * n_rows), layout="constrained")
    figure.suptitle(f"{title}: capacitance of each element [pF], forwards up")
    axes = figure.subplots(n_rows, _FEET_PER_ROW, squeeze=False).ravel()
    for ax in axes:
        ax.set_axis_off()
    for ax, report in zip(axes, result.legs, strict=False):
        ax.set_title(report.leg)
        if report.scans is None:
            ax.text(
                0.5, 0.5, "not scanned", ha="center", va="center", color="tab:red", transform=ax.transAxes
            )
            continue
        mean_pf = report.scans.mean_pf
        marks = element_marks(report)
        sound = np.array([not wrong for _, wrong in marks])
        middle_pf = np.median(mean_pf[sound]) if sound.any() else np.nan
        off_rel = np.where(sound, mean_pf / middle_pf - 1.0, np.nan)
        ax.imshow(off_rel.reshape(ROWS, ROWS), cmap="coolwarm", vmin=-0.05, vmax=0.05)
        for element, (mark, wrong) in enumerate(marks):
            row, column = divmod(element, ROWS)
            ax.text(column, row, mark, ha="center", va="center", color="tab:red" if wrong else "black")
    try:
        figure.savefig(file, dpi=150)
    except (OSError, ValueError) as error:
        raise FootsenseError(f"{file}: {error}") from error
