"""Figures of a run as a text table."""

from typing import Any

from rich.console import Console
from rich.table import Table

from footsense.frames import FAULT_FREE, State


def print_summary(console: Console, figures: dict[str, Any]) -> None:
    """Print the main figures of a run as a table; all of them are in `footsense run --summary json`."""
    table = Table(box=None, show_header=False, padding=(0, 2), pad_edge=False)
    table.add_column(style="bold")
    table.add_column()

    row = table.add_row
    rate_hz = figures["cycle_rate_hz"]
    row("cycles", f"{figures['cycles']}" + (f" at {rate_hz:.1f} Hz" if rate_hz else ""))
    rmse_n = figures.get("force_rmse_n")
    if rmse_n is not None and rmse_n["x"] is not None:
        row(
            "force error",
            "  ".join(f"{axis} {1e3 * value:.1f}" for axis, value in rmse_n.items()) + "  mN rms",
        )
    direction = figures.get("direction_error_deg")
    if direction is not None and direction["mean"] is not None:
        row(
            "direction error",
            f"mean {direction['mean']:.2f} deg, p95 {direction['p95']:.2f} deg over "
            f"{direction['loaded_frames']} loaded frames",
        )
    magnitude = figures.get("magnitude_error_rel")
    if magnitude is not None and magnitude["mean"] is not None:
        row(
            "magnitude error",
            f"mean {100.0 * magnitude['mean']:.1f} %, p95 {100.0 * magnitude['p95']:.1f} % over the same",
        )
    age_ms = figures["age_ms"]
    if age_ms["p50"] is not None:
        row("age when sent", f"p50 {age_ms['p50']:.1f} ms, p99 {age_ms['p99']:.1f} ms")
    can = figures["can"]
    row("CAN", f"{can['sent']} frames sent, {can['dropped']} dropped")
    if figures["cycles_not_recorded"]:
        row("recording", f"{figures['cycles_not_recorded']} cycles lost")
    for leg, states in figures["states"].items():
        others = {state: n for state, n in states.items() if State[state.upper()] not in FAULT_FREE}
        if others:
            row(f"leg {leg}", ", ".join(f"{n} x {state}" for state, n in others.items()))
    console.print(table)
