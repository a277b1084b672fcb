"""Study `touchdown`: latency from touchdown to the first frame that reports contact, and false contacts."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from footsense.benchmarks.latency_vs_error.chain import conversion_timing
from footsense.benchmarks.touchdown.run import PublishedRun, simulate_touchdowns
from footsense.benchmarks.touchdown.touchdowns import (
    CONTACT_THRESHOLD_N,
    TOUCHDOWNS,
    VIBRATION_N,
    RandomTouchdowns,
)
from footsense.frames import Mask, Vector
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row

#: Feet of each manner, and length of the run [s].
_FULL, _QUICK = (6, 25.0), (2, 4.0)
#: Time after a touchdown in which the error counts [s].
_FORCE_ERROR_WINDOW_S = 0.05
#: Upper bound of a Poisson mean at 95 % without an occurrence.
_POISSON_UPPER_95_FOR_ZERO_EVENTS = 3
_SEED = 5
_FIGURE_FILE = "touchdown.png"

#: Median and 99th percentile [ms].
_P50P99 = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Latencies:
    """Touchdown latencies (median, 99th percentile) and force error, for one type of touchdown.

    Attributes:
        contact_latency_ms: Latency of the flag CONTACT, from a load of `CONTACT_THRESHOLD_N` on [ms].
        force_latency_ms: Latency of the first force above `CONTACT_THRESHOLD_N` [ms].
        force_rms_error_mn: Error of the force along the leg in the time after a touchdown, rms [mN].
    """

    contact_latency_ms: _P50P99
    force_latency_ms: _P50P99
    force_rms_error_mn: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseReports:
    """Numbers of false contacts in swing and in the first 0.1 s after lift-off, with the time observed.

    Attributes:
        swing_minutes: Time in swing of all feet [min].
        false_contacts_swing_liftoff: False flags CONTACT.
        false_forces_swing_liftoff: Forces above `CONTACT_THRESHOLD_N` without load.
        zero_event_rate_upper95_per_h: Upper bound of a rate of which no case occurred, at 95 % [1/h].
        max_swing_force_mn: Largest force along the leg in swing [mN].
    """

    swing_minutes: float
    false_contacts_swing_liftoff: tuple[int, int]
    false_forces_swing_liftoff: tuple[int, int]
    zero_event_rate_upper95_per_h: float
    max_swing_force_mn: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchdownResults:
    """Results of the study `touchdown`: latencies by type of touchdown, and false contacts.

    Attributes:
        n_touchdowns_per_type: Touchdowns of each manner.
        latencies: Latencies by manner of touchdown.
        median_latency_ms: Median latency over all manners, of the flag (`contact`) and of the force (`force`) [ms].
        false_reports: False reports.
    """

    n_touchdowns_per_type: int
    latencies: dict[str, Latencies]
    median_latency_ms: dict[str, float]
    false_reports: FalseReports


#: Latencies after each touchdown, of the flag and of the force [ms].
_LatenciesMs = tuple[Vector, Vector]


def _first_report_latency_ms(reported: Mask, sent_s: Vector, starts_s: Vector, crossed_s: Vector) -> Vector:
    """Return the latency from each touchdown of one foot to its first report [ms], shape (touchdowns,)."""
    first = [np.flatnonzero(reported & (sent_s > start_s))[0] for start_s in starts_s.tolist()]
    latencies_ms: Vector = 1e3 * (sent_s[first] - crossed_s)
    return latencies_ms


def _latencies(
    result: PublishedRun, steps: RandomTouchdowns, until_s: float, kind: int
) -> tuple[_LatenciesMs, float]:
    """Return all touchdown latencies of one type [ms], and the rms force error after touchdown [mN]."""
    contact_latency_ms, force_latency_ms, squares_n2 = [], [], []
    for foot in np.flatnonzero(steps.kind == kind).tolist():
        complete = steps.crossed_s[foot] < until_s - 2 * _FORCE_ERROR_WINDOW_S
        times = result.sent_s, steps.starts_s[foot, complete], steps.crossed_s[foot, complete]
        contact_latency_ms.append(_first_report_latency_ms(result.contact[:, foot], *times))
        force_latency_ms.append(
            _first_report_latency_ms(result.axial_force_n[:, foot] > CONTACT_THRESHOLD_N, *times)
        )
        error_n = result.axial_force_n[:, foot] - result.true_axial_force_n[:, foot]
        for crossed_s in times[2].tolist():
            after = (result.sent_s > crossed_s) & (result.sent_s < crossed_s + _FORCE_ERROR_WINDOW_S)
            squares_n2.append(np.nanmean(error_n[after] ** 2))
    force_rms_error_mn = 1e3 * float(np.sqrt(np.mean(squares_n2)))
    return (np.concatenate(contact_latency_ms), np.concatenate(force_latency_ms)), force_rms_error_mn


def _p50_p99(values_ms: Vector) -> _P50P99:
    """Return the median and the 99th percentile [ms]."""
    p50, p99 = np.percentile(values_ms, (50, 99)).tolist()
    return p50, p99


def _false_reports(result: PublishedRun) -> FalseReports:
    """Return the numbers of false contacts in swing, and the time in swing."""
    hours = float(np.gradient(result.sent_s) @ result.is_swing.sum(axis=1)) / 3600
    swings = result.is_swing[1:]

    def count_false_reports(reported: Mask) -> tuple[int, int]:
        begins = reported[1:] & ~reported[:-1] & (result.true_axial_force_n[1:] == 0.0)
        return int((begins & swings).sum()), int((begins & ~swings).sum())

    return FalseReports(
        swing_minutes=60 * hours,
        false_contacts_swing_liftoff=count_false_reports(result.contact),
        false_forces_swing_liftoff=count_false_reports(result.axial_force_n > CONTACT_THRESHOLD_N),
        zero_event_rate_upper95_per_h=_POISSON_UPPER_95_FOR_ZERO_EVENTS / hours,
        max_swing_force_mn=1e3 * float(np.nanmax(result.axial_force_n[result.is_swing])),
    )


def _figure(latencies: dict[str, _LatenciesMs]) -> Figure:
    """Return a figure of the fraction of reported touchdowns over the time since touchdown."""
    figure, axes = subplot_row(2, 9.0, 3.4, sharey=True)
    for axis, speed in zip(axes, ("hard", "soft"), strict=True):
        for report, (style, label) in enumerate((("-", "Contact"), (":", "force"))):
            kinds = [each[report] for kind, each in latencies.items() if kind.startswith(speed)]
            all_ms = np.sort(np.concatenate(kinds))
            share = 100 * np.arange(1, len(all_ms) + 1) / len(all_ms)
            axis.step(all_ms, share, style, where="post", color="tab:blue", label=label)
        axis.set(
            title=f"{speed} touchdowns",
            xlabel=f"time since {1e3 * CONTACT_THRESHOLD_N:g} mN [ms]",
            xlim=(0, 45),
        )
    axes[0].set_ylabel("reported touchdowns [%]")
    axes[0].legend(fontsize=8, loc="lower right")
    return figure


def compute(context: StudyContext) -> tuple[TouchdownResults, Plots]:
    """Run the study `touchdown`; return its results and figures."""
    n_feet, until_s = _QUICK if context.quick else _FULL
    steps = RandomTouchdowns(n_feet, until_s, np.random.default_rng(_SEED))
    result = simulate_touchdowns(context, steps, until_s, _SEED)
    latencies: dict[str, Latencies] = {}
    latencies_by_type_ms: dict[str, _LatenciesMs] = {}
    for kind, name in enumerate(TOUCHDOWNS):
        latencies_by_type_ms[name], force_rms_error_mn = _latencies(result, steps, until_s, kind)
        contact_latency_ms, force_latency_ms = map(_p50_p99, latencies_by_type_ms[name])
        latencies[name] = Latencies(
            contact_latency_ms=contact_latency_ms,
            force_latency_ms=force_latency_ms,
            force_rms_error_mn=force_rms_error_mn,
        )
    reports = zip(("contact", "force"), zip(*latencies_by_type_ms.values(), strict=True), strict=True)
    results = TouchdownResults(
        n_touchdowns_per_type=len(latencies_by_type_ms[next(iter(TOUCHDOWNS))][0]),
        latencies=latencies,
        median_latency_ms={report: float(np.median(np.concatenate(kinds))) for report, kinds in reports},
        false_reports=_false_reports(result),
    )
    return results, {_FIGURE_FILE: _figure(latencies_by_type_ms)}


STUDY = Study(
    name="touchdown",
    title="Touchdown",
    compute=compute,
    template_names={
        "TOUCHDOWNS": TOUCHDOWNS,
        "contact_mn": 1e3 * CONTACT_THRESHOLD_N,
        "tremor_mn": 1e3 * VIBRATION_N,
        "after_ms": 1e3 * _FORCE_ERROR_WINDOW_S,
        "step_ms": conversion_timing(400).step_ns * 1e-6,
        "lead_ms": conversion_timing(400).send_delay_ns * 1e-6,
    },
)
