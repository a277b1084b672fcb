"""Rate, averaging, publish mode and network size against latency, noise and error on a walk."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from firmware_interface.can_codes import NODE_IDS
from firmware_interface.wire_timing import FRAMES_PER_LEG, LONGEST_FRAME_BITS
from footsense.acquisition.scan_plan import ORDERS
from footsense.benchmarks.latency_vs_error.chain import Readings, convert, pace
from footsense.benchmarks.latency_vs_error.latency_and_errors import (
    LatencyAndErrors,
    TrueLoads,
    latency_and_errors,
    rms_mn,
)
from footsense.benchmarks.latency_vs_error.publishing import by_element, by_frame
from footsense.foot.files.network_card import TrainedInputs
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, Vector
from footsense.ports import Estimator
from footsense.sim.loads.ground_load import Ramp

#: Load of the standing feet of which the noise is measured [N].
STANDING_N = (0.1, 0.05, 0.5)
_SEED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingPoint:
    """Latency, noise and errors of one configuration of the robot.

    Attributes:
        rate_sps: Conversions per second.
        average_scans: Scans that are averaged.
        publish: `frame` or `element`.
        weights: Weights of the network.
        forces_hz: Forces of a leg per second [Hz].
        can_kbit_s: Load of six legs on CAN at most [kbit/s].
        noise_mn: Noise of the force of a standing foot, all axes, rms [mN].
        walk: Latency and errors on the walk.
    """

    rate_sps: int
    average_scans: int
    publish: str
    weights: int
    forces_hz: float
    can_kbit_s: float
    noise_mn: float
    walk: LatencyAndErrors


class WalkAndStand(NamedTuple):
    """Readings of walking and of standing feet at one rate.

    Attributes:
        rate_sps: Conversions per second.
        truth: True loads of the walking feet.
        walk: Readings of the walking feet.
        standing: Readings of the standing feet.
    """

    rate_sps: int
    truth: TrueLoads
    walk: Readings
    standing: Readings

    @classmethod
    def at(cls, rate_sps: int, foot: Foot, truth: TrueLoads) -> "WalkAndStand":
        """Convert feet of one make."""
        standing = [partial(Ramp(STANDING_N, 0).contact, leg) for leg in NODE_IDS]
        order, end_ns = ORDERS["lo_shu"], truth.end_ns
        return cls(
            rate_sps,
            truth,
            convert(foot, truth.feet, order, rate_sps, end_ns, _SEED),
            convert(foot, standing, order, rate_sps, end_ns, _SEED + 1),
        )

    def operating_point(
        self, network: Estimator, card: TrainedInputs, average_scans: int, publish: str, weights: int
    ) -> OperatingPoint:
        """Return one operating point at this rate; arguments as the attributes of `OperatingPoint`."""
        walk, standing = (
            by_element(readings, network, card)
            if publish == "element"
            else by_frame(readings, network, card, average_scans)
            for readings in (self.walk, self.standing)
        )
        forces_hz = 1e9 / pace(self.rate_sps).step_ns / (1 if publish == "element" else ELEMENTS)
        standing_n = standing.force_n[standing.sent_ns >= self.truth.start_ns]
        return OperatingPoint(
            rate_sps=self.rate_sps,
            average_scans=average_scans,
            publish=publish,
            weights=weights,
            forces_hz=forces_hz,
            can_kbit_s=forces_hz * len(NODE_IDS) * FRAMES_PER_LEG * LONGEST_FRAME_BITS * 1e-3,
            noise_mn=rms_mn(standing_n - standing_n.mean(axis=0)),
            walk=latency_and_errors(walk, self.truth),
        )


def _xy(points: Sequence[OperatingPoint], panel: str) -> tuple[Vector, Vector]:
    """Return latencies [ms], and errors or noises [mN]."""
    latency_ms = np.array([p.walk.age_held_ms[0] for p in points])
    return latency_ms, np.array(
        [p.walk.held_error_norm_mn if panel == "error" else p.noise_mn for p in points]
    )


def _annotate(
    axes: Axes, point: OperatingPoint, panel: str, text: str, offset: tuple[int, int], colour: str
) -> None:
    """Write a text beside a point."""
    (x,), (y,) = _xy([point], panel)
    axes.annotate(
        text, (x, y), offset, textcoords="offset points", fontsize=8, color=colour, ha="center", va="center"
    )


def grid_figure(points: Sequence[OperatingPoint], sizes: Sequence[OperatingPoint]) -> Figure:
    """Draw error and noise over latency: a line for each rate, over the number of averaged scans."""
    figure = Figure(figsize=(10.4, 4.6), layout="constrained")
    panels = figure.subplots(1, 2)
    rates = sorted({p.rate_sps for p in points}, reverse=True)
    for axes, panel in zip(panels, ("error", "noise"), strict=True):
        for colour, rate, aside in zip(("C0", "C2", "C1"), rates, ((-8, -6), (0, -10), (8, 6)), strict=False):
            scans, single = (
                [p for p in points if p.rate_sps == rate and p.publish == publish]
                for publish in ("frame", "element")
            )
            axes.plot(*_xy(scans, panel), "o-", color=colour, ms=5, label=f"frame, {rate} S/s")
            for p in scans:
                _annotate(
                    axes, p, panel, f"{p.average_scans}", (7, -8) if panel == "error" else aside, colour
                )
            axes.plot(
                *_xy(single, panel), "*", color=colour, ms=13, mec="k", mew=0.5, label=f"element, {rate} S/s"
            )
        axes.set(xscale="log", yscale="log", xlabel="age of the held force, median [ms]")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3)
    panels[0].plot(*_xy(sizes, "error"), "_", color="0.35", ms=10, label="fewer weights, 400 S/s")
    for p in sizes:
        _annotate(panels[0], p, "error", f"{p.weights}", (-16 if p.publish == "frame" else 16, 0), "0.35")
    panels[0].set(ylabel="error of the held force on the walk, rms [mN]")
    panels[1].set(ylabel="noise of a standing foot, rms [mN]")
    panels[0].legend(fontsize=8, loc="lower right")
    return figure
