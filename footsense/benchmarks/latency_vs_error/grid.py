"""Rate, averaging, publish mode and size of the network against latency, noise and error on a walk."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from firmware_interface.can_frames import NODE_IDS
from footsense.benchmarks.latency_vs_error.chain import (
    ORDERS,
    Published,
    Readings,
    by_element,
    by_frame,
    convert,
    pace,
)
from footsense.benchmarks.latency_vs_error.errors import Judged, Truth, judge, rms_mn
from footsense.foot.network_card import TrainedInputs
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS
from footsense.lab.studies.page import table
from footsense.lab.training.export import OnnxNetwork, onnx_model
from footsense.lab.training.network import Weights
from footsense.ports import Estimator
from footsense.sim.loads.ground_load import Ramp

#: Bits of a classic CAN frame of 8 bytes at worst, its pause included, and frames of a leg: `Force` and `Quality`.
FRAME_BITS, FRAMES_PER_LEG = 135, 2
#: What a foot stands on in the test for noise [N].
STANDING_N = (0.1, 0.05, 0.5)

_SEED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One way to run the robot.

    Attributes:
        rate_sps: Conversions per second.
        average_scans: Scans that are averaged.
        publish: `frame` or `element`.
        weights: Weights of the network.
        forces_hz: Forces of a leg per second [Hz].
        can_kbit_s: What six legs of them take on CAN at most [kbit/s].
        noise_mn: Noise of the force of a foot that stands still, all axes, rms [mN].
        walk: Errors on the walk.
    """

    rate_sps: int
    average_scans: int
    publish: str
    weights: int
    forces_hz: float
    can_kbit_s: float
    noise_mn: float
    walk: Judged


class Bench:
    """The walk and the standing foot, converted once for every rate.

    Args:
        foot: How the feet yield.
        truth: What walking ones feel.
    """

    def __init__(self, foot: Foot, truth: Truth) -> None:
        self._foot = foot
        self._truth = truth
        self._converted: dict[int, tuple[Readings, Readings]] = {}

    def point(
        self,
        network: Estimator,
        card: TrainedInputs,
        rate_sps: int,
        average_scans: int,
        publish: str,
        weights: int,
    ) -> Point:
        """Return what one way to run the robot is worth; arguments as the attributes of `Point`."""
        if rate_sps not in self._converted:
            self._converted[rate_sps] = self._convert(rate_sps)
        walk, standing = (
            by_element(readings, network, card)
            if publish == "element"
            else by_frame(readings, network, card, average_scans)
            for readings in self._converted[rate_sps]
        )
        forces_hz = 1e9 / pace(rate_sps).step_ns / (1 if publish == "element" else ELEMENTS)
        return Point(
            rate_sps=rate_sps,
            average_scans=average_scans,
            publish=publish,
            weights=weights,
            forces_hz=forces_hz,
            can_kbit_s=forces_hz * len(NODE_IDS) * FRAMES_PER_LEG * FRAME_BITS * 1e-3,
            noise_mn=self._noise_mn(standing),
            walk=judge(walk, self._truth),
        )

    def _convert(self, rate_sps: int) -> tuple[Readings, Readings]:
        order, until_ns = ORDERS["lo_shu"], self._truth.end_ns
        standing = [partial(Ramp(STANDING_N, 0).contact, leg) for leg in NODE_IDS]
        return (
            convert(self._foot, self._truth.feet, order, rate_sps, until_ns, _SEED),
            convert(self._foot, standing, order, rate_sps, until_ns, _SEED + 1),
        )

    def _noise_mn(self, published: Published) -> float:
        force_n = published.force_n[published.sent_ns >= self._truth.begin_ns]
        return rms_mn(force_n - force_n.mean(axis=0))


def as_runtime(weights: Weights) -> OnnxNetwork:
    """Return a trained network as ONNX Runtime computes it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        path.write_bytes(onnx_model(weights, {}).SerializeToString())
        return OnnxNetwork(path)


def grid_table(points: Sequence[Point]) -> str:
    """Return the points as a table."""
    header = [
        "publish, scans averaged",
        "S/s",
        "weights",
        "forces/s",
        "CAN at 500 kbit/s",
        "age in use p50 / p99 [ms]",
        "behind [ms]",
        "noise, standing [mN]",
        "error on the walk, at any time [mN]",
        "direction [deg]",
        "error when sent [mN]",
    ]
    rows = [
        [
            p.publish if p.publish == "element" else f"frame, {p.average_scans}",
            f"{p.rate_sps}",
            f"{p.weights}",
            f"{p.forces_hz:.0f}",
            f"{p.can_kbit_s / 500:.0%}",
            f"{p.walk.age_used_ms[0]:.1f} / {p.walk.age_used_ms[1]:.1f}",
            f"{p.walk.behind_ms:.1f}",
            f"{p.noise_mn:.2f}",
            f"{p.walk.used_total_mn:.1f}",
            f"{p.walk.used_direction_deg:.1f}",
            f"{p.walk.sent_total_mn:.1f}",
        ]
        for p in points
    ]
    return table(header, rows)


def _xy(points: Sequence[Point], what: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return latencies [ms] and errors or noises [mN]."""
    latency = np.array([p.walk.age_used_ms[0] for p in points])
    return latency, np.array([p.walk.used_total_mn if what == "error" else p.noise_mn for p in points])


def _annotate(axes: Axes, point: Point, what: str, text: str, offset: tuple[int, int], colour: str) -> None:
    """Write something beside a point."""
    (x,), (y,) = _xy([point], what)
    axes.annotate(
        text, (x, y), offset, textcoords="offset points", fontsize=8, color=colour, ha="center", va="center"
    )


def grid_figure(points: Sequence[Point], sizes: Sequence[Point]) -> Figure:
    """Return error and noise against latency: a line for each rate, its number of averaged scans growing along it."""
    figure = Figure(figsize=(10.4, 4.6), layout="constrained")
    panels = figure.subplots(1, 2)
    rates = sorted({p.rate_sps for p in points}, reverse=True)
    for axes, what in zip(panels, ("error", "noise"), strict=True):
        for colour, rate, aside in zip(("C0", "C2", "C1"), rates, ((-8, -6), (0, -10), (8, 6)), strict=False):
            scans = [p for p in points if p.rate_sps == rate and p.publish == "frame"]
            axes.plot(*_xy(scans, what), "o-", color=colour, ms=5, label=f"frame, {rate} S/s")
            for p in scans:
                _annotate(axes, p, what, f"{p.average_scans}", (7, -8) if what == "error" else aside, colour)
            single = [p for p in points if p.rate_sps == rate and p.publish == "element"]
            axes.plot(
                *_xy(single, what), "*", color=colour, ms=13, mec="k", mew=0.5, label=f"element, {rate} S/s"
            )
        axes.set(xscale="log", yscale="log", xlabel="age of the force in use, median [ms]")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3)
    panels[0].plot(*_xy(sizes, "error"), "_", color="0.35", ms=10, label="fewer weights, 400 S/s")
    for p in sizes:
        _annotate(panels[0], p, "error", f"{p.weights}", (-16 if p.publish == "frame" else 16, 0), "0.35")
    panels[0].set(ylabel="error on the walk, at any time, rms [mN]")
    panels[1].set(ylabel="noise of a standing foot, rms [mN]")
    panels[0].legend(fontsize=8, loc="lower right")
    return figure
