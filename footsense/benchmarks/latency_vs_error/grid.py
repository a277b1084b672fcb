"""Force noise, latency and error at several conversion rates and publishing intervals (operating points)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from firmware_interface.conversion_order import CONVERSION_ORDERS
from firmware_interface.wire_timing import FRAMES_PER_LEG, LONGEST_FRAME_BITS
from footsense.benchmarks.latency_vs_error.chain import FootLoad, conversion_timing, simulate_conversions
from footsense.benchmarks.latency_vs_error.latency_and_errors import (
    LatencyAndErrors,
    TrueLoads,
    latency_and_errors,
    rms_mn,
)
from footsense.benchmarks.latency_vs_error.publishing import estimate_forces
from footsense.config import DEFAULT
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, LEGS
from footsense.lab.former_page import StudyContext
from footsense.lab.plots import subplot_row
from footsense.sim.loads.ground_load import RampContact

#: Load of the standing feet of which the noise is measured [N].
STANDING_FORCE_N = (0.1, 0.05, 0.5)
#: Conversions for each published force: all, the daemon's default, and one force for each scan.
CONVERSIONS_PER_PUBLISHED_FORCE = (1, DEFAULT.publish_every, ELEMENTS)
_SEED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingPointResult:
    """Latency, noise and errors of one combination of conversion rate and publishing interval.

    Attributes:
        rate_sps: Conversions per second.
        publish_every: Conversions for each published force.
        forces_hz: Forces of a leg per second [Hz].
        can_kbit_s: Load of six legs on CAN at most [kbit/s].
        standing_noise_norm_rms_mn: Rms length of the deviation of a standing foot's force from its mean [mN].
        walk: Latency and errors on the walk.
    """

    rate_sps: int
    publish_every: int
    forces_hz: float
    can_kbit_s: float
    standing_noise_norm_rms_mn: float
    walk: LatencyAndErrors


def measure_operating_points(
    rate_sps: int, truth: TrueLoads, context: StudyContext
) -> list[OperatingPointResult]:
    """Return the operating points at one conversion rate, one per publishing interval.

    Args:
        rate_sps: Conversions per second.
        truth: True loads of the walking feet.
        context: Response table and network.
    """
    standing_feet: Sequence[FootLoad] = [
        partial(RampContact(STANDING_FORCE_N, 0).contact, leg) for leg in LEGS
    ]
    foot, order = Foot(context.response), CONVERSION_ORDERS["lo_shu"]
    walk, standing = (
        estimate_forces(
            simulate_conversions(foot, feet, order, rate_sps, truth.evaluation_end_ns, seed),
            context.network,
            context.trained_inputs,
        )
        for seed, feet in enumerate((truth.feet, standing_feet), _SEED)
    )
    standing_n = standing.force_n[standing.sent_ns >= truth.evaluation_start_ns]
    noise_mn = rms_mn(standing_n - standing_n.mean(axis=0))
    points = []
    for every in CONVERSIONS_PER_PUBLISHED_FORCE:
        forces_hz = 1e9 / conversion_timing(rate_sps).step_ns / every
        points.append(
            OperatingPointResult(
                rate_sps=rate_sps,
                publish_every=every,
                forces_hz=forces_hz,
                can_kbit_s=forces_hz * len(LEGS) * FRAMES_PER_LEG * LONGEST_FRAME_BITS * 1e-3,
                standing_noise_norm_rms_mn=noise_mn,
                walk=latency_and_errors(walk.every_nth(every), truth),
            )
        )
    return points


def operating_points_figure(points: Sequence[OperatingPointResult]) -> Figure:
    """Return a figure of the force error on the walk over the age of the force: one curve per rate."""
    figure, (axes,) = subplot_row(1, 6.4, 4.4)
    for rate in sorted({p.rate_sps for p in points}, reverse=True):
        of_rate = [p for p in points if p.rate_sps == rate]
        ages_ms = [p.walk.held_age_p50_p99_ms[0] for p in of_rate]
        errors_mn = [p.walk.held_error_norm_rms_mn for p in of_rate]
        axes.plot(ages_ms, errors_mn, "o-", label=f"{rate} S/s")
        for p, age_ms, error_mn in zip(of_rate, ages_ms, errors_mn, strict=True):
            axes.annotate(
                f"{p.publish_every}", (age_ms, error_mn), (7, -8), textcoords="offset points", fontsize=8
            )
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="age of the held force, median [ms]",
        ylabel="error of the held force on the walk, rms [mN]",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.legend(fontsize=8)
    return figure
