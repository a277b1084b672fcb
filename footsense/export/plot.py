"""Plot a recording: forces, states and events of every leg over time; needs the extra `plot`."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from footsense.errors import FootsenseError, RecordingError
from footsense.frames import IS_USABLE_STATE, GaitEvent, GaitEventKind, Mask, State, Vector
from footsense.leg_words import word_of
from footsense.recording.replay import Replay

_PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
#: Row and column of each leg, as on the robot from above.
_SUBPLOT_OF_LEG = {
    side + place: (row, column) for row, place in enumerate("fmr4") for column, side in enumerate("lr")
}
_SIDE_NAMES = {"l": "left", "r": "right"}
_POSITION_NAMES = {"f": "front", "m": "middle", "r": "rear", "4": "fourth"}
_NORMAL, _TANGENTIAL, _CONTACT = "#1f5fa8", "#d97706", "#dbeafe"
_STATE_COLOURS = {
    State.VALID: "#8cc08a",
    State.DEGRADED: "#f2c14e",
    State.STARTING: "#d9d9d9",
    State.NO_BASELINE: "#bdbdbd",
    State.TARING: "#9ecae1",
    State.STOPPED: "#969696",
    State.OUT_OF_RANGE: "#fdae6b",
    State.SATURATED: "#e6550d",
    State.STALE: "#b15fb5",
    State.ELEMENT_FAULT: "#d62728",
    State.CONVERTER_FAULT: "#8c1d18",
    State.ABSENT: "#3b3b3b",
}
_EVENT_MARKERS = {
    GaitEventKind.TOUCHDOWN: ("v", "#1b7837", "touchdown"),
    GaitEventKind.LIFT_OFF: ("^", "#1b7837", "lift-off"),
    GaitEventKind.SLIP: ("x", "#b2182b", "slip begins"),
    GaitEventKind.SLIP_END: ("+", "#b2182b", "slip ends"),
}
#: Part of a panel's height below zero, where states and events stand.
_STATE_STRIP_HEIGHT_REL = 0.16
#: A line with more points is drawn as its extremes within so many columns.
_MAX_PLOTTED_COLUMNS = 2_000


@dataclass
class _Signals:
    """Signals of a recording for its plot; times in seconds since the first cycle.

    Attributes:
        cycles: A record for each cycle: `t_s`; of each leg `state`, and forces [N], NaN unless usable: `along_n` the
            leg, its `sigma_n`, `across_n`.
        contact_t_s: Time of each gait.
        contact: Debounced contact of each leg, for each gait.
        events: Times and events of the gait.
    """

    cycles: NDArray[np.void]
    contact_t_s: list[float] = field(default_factory=list)
    contact: list[Mask] = field(default_factory=list)
    events: list[tuple[float, GaitEvent]] = field(default_factory=list)

    def of(self, name: str, row: int) -> Any:  # noqa: ANN401 - an array of the field's type
        """Return a leg's signal."""
        return self.cycles[name][:, row]


def _read_signals(replay: Replay) -> tuple[_Signals, RecordingError | None]:
    """Return the plotted signals of a recording, 86 bytes a cycle of six legs, and the error that ended it early."""
    n, damages = len(replay.legs), list[RecordingError]()
    numbers = [(name, "f4", (n,)) for name in ("along_n", "sigma_n", "across_n")]
    layout = np.dtype([("t_s", "f8"), ("state", "u1", (n,)), *numbers])
    signals = _Signals(np.empty(0, layout))

    def records() -> Iterator[tuple[Any, ...]]:
        first_ns = None
        try:
            for cycle in replay:
                forces, gait = cycle.forces, cycle.forces.gait
                first_ns = forces.t_sent_ns if first_ns is None else first_ns
                t_s = (forces.t_sent_ns - first_ns) * 1e-9
                usable = IS_USABLE_STATE[forces.state]
                if gait is not None:
                    signals.contact_t_s.append(t_s)
                    signals.contact.append(gait.contact & usable)
                    signals.events += [((event.t_ns - first_ns) * 1e-9, event) for event in gait.events]
                x, y, z = forces.force_n.T
                known = (
                    np.where(usable, values, np.nan) for values in (z, forces.sigma_n[:, 2], np.hypot(x, y))
                )
                yield (t_s, forces.state, *known)
        except RecordingError as error:
            damages.append(error)

    signals.cycles = np.fromiter(records(), layout)
    return signals, damages[0] if damages else None


def require_picture_suffix(path: Path) -> None:
    """Raise an error unless a picture file of this name can be drawn.

    Raises:
        FootsenseError: There is no such kind of file.
    """
    if path.suffix not in _PICTURE_SUFFIXES:
        raise FootsenseError(f"{path}: a picture ends in {', '.join(_PICTURE_SUFFIXES)}")


def write_plot(replay: Replay, path: Path) -> int:
    """Plot a recording to a picture file; return the number of cycles.

    Args:
        replay: The recording.
        path: The new file; its ending says its kind.

    Raises:
        FootsenseError: As `require_picture_suffix`.
        OSError: The file cannot be written.
        RecordingError: The recording is cut short; what is whole was drawn.
    """
    require_picture_suffix(path)
    signals, damage = _read_signals(replay)
    # Rows and columns without a leg are left out: a test stand has one leg.
    lines, columns = (sorted({_SUBPLOT_OF_LEG[leg][part] for leg in replay.legs}) for part in (0, 1))
    figure = Figure(figsize=(12, 1.3 + 2.4 * len(lines)), layout="constrained")
    figure.suptitle(_plot_title(replay, signals), fontsize=11, x=0.01, ha="left")
    axes = figure.subplots(len(lines), len(columns), sharex=True, sharey=True, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    force_axis_max_n = _force_axis_max_n(signals)
    for row, leg in enumerate(replay.legs):
        line, column = _SUBPLOT_OF_LEG[leg]
        axis = axes[lines.index(line), columns.index(column)]
        axis.set_axis_on()
        _draw_leg(axis, signals, row, leg, force_axis_max_n)
    for axis in axes[:, 0]:
        axis.set_ylabel("force [N]")
        axis.set_yticks([tick for tick in axis.get_yticks() if 0 <= tick <= force_axis_max_n])
        if axis.axison:
            axis.text(-0.01, 0.03, "state", transform=axis.transAxes, ha="right", fontsize=8)
            axis.text(-0.01, 0.14, "events", transform=axis.transAxes, ha="right", fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("time after the first cycle [s]")
    figure.legend(
        handles=_legend_entries(signals), loc="outside lower center", ncols=7, fontsize=8, frameon=False
    )
    figure.savefig(path, dpi=150)
    if damage is not None:
        raise damage
    return len(signals.cycles)


def _plot_title(replay: Replay, signals: _Signals) -> str:
    header, n_cycles = replay.header, len(signals.cycles)
    span_s = signals.cycles["t_s"].max(initial=0.0)
    source = "simulated" if header.get("scene") else "robot"
    return (
        f"{replay.path.name}   {header.get('started', '')}   {source}, foot type {header.get('foot_type', '?')}   "
        f"{span_s:.1f} s, {n_cycles} cycles, {len(signals.events)} gait events"
    )


def _force_axis_max_n(signals: _Signals) -> float:
    values = signals.cycles["along_n"]
    return max(0.1, 1.15 * float(values[np.isfinite(values)].max(initial=0.0)))


def _draw_leg(axis: Any, signals: _Signals, row: int, leg: str, force_axis_max_n: float) -> None:  # noqa: ANN401 - not typed
    """Draw the forces, contacts, states and events of one leg."""
    bottom_n = -_STATE_STRIP_HEIGHT_REL * force_axis_max_n
    axis.set_title(f"{leg}  {_SIDE_NAMES[leg[0]]} {_POSITION_NAMES[leg[1]]}", loc="left", fontsize=9)
    axis.set_ylim(2 * bottom_n, force_axis_max_n)
    axis.margins(x=0)
    axis.axhline(0, color="#888888", linewidth=0.6)
    touches = np.array([contact[row] for contact in signals.contact], np.bool_)
    for start_s, end_s in _true_spans(np.array(signals.contact_t_s), touches):
        axis.axvspan(start_s, end_s, color=_CONTACT, linewidth=0)
    t_s, along_n, sigma_n = signals.cycles["t_s"], signals.of("along_n", row), signals.of("sigma_n", row)
    if _shows_sigma(signals):
        band_n = along_n - 2 * sigma_n, along_n + 2 * sigma_n
        axis.fill_between(t_s, *band_n, color=_NORMAL, alpha=0.3, linewidth=0)
    axis.plot(*_decimate(t_s, along_n), color=_NORMAL, linewidth=1.0)
    axis.plot(*_decimate(t_s, signals.of("across_n", row)), color=_TANGENTIAL, linewidth=0.8)
    for state, color in _STATE_COLOURS.items():
        spans = _true_spans(t_s, signals.of("state", row) == state)
        widths = [(start_s, end_s - start_s) for start_s, end_s in spans]
        axis.broken_barh(widths, (2 * bottom_n, -0.6 * bottom_n), facecolors=color, linewidth=0)
    for kind, (mark, color, _) in _EVENT_MARKERS.items():
        marked_s = [event_s for event_s, event in signals.events if event.leg == row and event.kind is kind]
        axis.plot(marked_s, [0.6 * bottom_n] * len(marked_s), mark, color=color, markersize=4)


def _shows_sigma(signals: _Signals) -> bool:
    """Return whether the recording is short enough for the uncertainty band to be visible."""
    return len(signals.cycles) <= 2 * _MAX_PLOTTED_COLUMNS


def _true_spans(t_s: Vector, holds: Mask) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a condition is true; each ends at the next sample."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    ends = np.append(t_s, t_s[-1:])
    return [(float(t_s[start]), float(ends[end])) for start, end in zip(edges[::2], edges[1::2], strict=True)]


def _decimate(t_s: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return a curve's points; for a long curve, only the minimum and maximum per pixel column."""
    if len(values) <= 2 * _MAX_PLOTTED_COLUMNS:
        return t_s, values
    size = len(values) // _MAX_PLOTTED_COLUMNS
    n_whole = len(values) // size * size
    columns = values[:n_whole].reshape(-1, size)
    extremes = np.stack([np.fmin.reduce(columns, axis=1), np.fmax.reduce(columns, axis=1)], axis=1)
    return np.repeat(t_s[:n_whole:size], 2), extremes.ravel()


def _legend_entries(signals: _Signals) -> list[Any]:
    """Return the legend entries of what the plot contains."""
    lines = [
        Line2D([], [], color=_NORMAL, label="along the leg" + ", ±2 sigma" * _shows_sigma(signals)),
        Line2D([], [], color=_TANGENTIAL, label="across the leg"),
        Patch(color=_CONTACT, label="contact"),
    ]
    kinds = {event.kind for _, event in signals.events}
    marks = [
        Line2D([], [], marker=mark, color=color, linestyle="", label=label)
        for kind, (mark, color, label) in _EVENT_MARKERS.items()
        if kind in kinds
    ]
    codes = set(np.unique(signals.cycles["state"]).tolist())
    states = [
        Patch(color=color, label=word_of(state)) for state, color in _STATE_COLOURS.items() if state in codes
    ]
    return lines + marks + states
