"""Tables and findings of the study `tradeoff`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from footsense.benchmarks.latency_vs_error.chain import BUS_HZ, HOST_COST_NS, pace
from footsense.benchmarks.latency_vs_error.errors import SIGMAS, LatencyAndErrors
from footsense.benchmarks.latency_vs_error.grid import FRAME_BITS, OperatingPoint, grid_table
from footsense.benchmarks.latency_vs_error.loads import LoadCase
from footsense.lab.studies.page import table

FIGURE = "tradeoff.png"


class Size(NamedTuple):
    """Size of the study.

    Attributes:
        strides: Strides of a walk that are counted.
        phases: Phases of a scan at which a foot is pressed.
        rates_sps: Conversions per second.
        averaged: Numbers of scans that are averaged.
        channels: Channels of the networks that are trained.
        cases: Loads in their training.
        training_steps: Steps of their training.
    """

    strides: int
    phases: int
    rates_sps: tuple[int, ...]
    averaged: tuple[int, ...]
    channels: tuple[int, ...]
    cases: int
    training_steps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """Result of one publishing method under one load.

    Attributes:
        method: Name of the method.
        order: Order of the scan.
        errors: Latency and errors.
        settling_ms: Time until the held force stays within a tenth of a step or ramp, median and worst [ms].
    """

    method: str
    order: str
    errors: LatencyAndErrors
    settling_ms: tuple[float, float] | None


#: Results of every method, by method and order.
Results = Mapping[tuple[str, str], MethodResult]


def _percent(shares: tuple[float, ...]) -> str:
    return " / ".join(f"{100 * share:.0f}" for share in shares)


_COLUMNS: dict[str, Callable[[MethodResult], str]] = {
    "publish, order": lambda r: f"{r.method}, {r.order}",
    "fx / fy / fz [mN]": lambda r: " / ".join(f"{value:.0f}" for value in r.errors.error_mn),
    "total [mN]": lambda r: f"{r.errors.error_total_mn:.0f}",
    "direction mean / p95 [deg]": lambda r: "{:.1f} / {:.1f}".format(*r.errors.direction_deg),
    "held: total [mN]": lambda r: f"{r.errors.held_total_mn:.0f}",
    "direction [deg]": lambda r: f"{r.errors.held_direction_deg:.1f}",
    f"% within {' / '.join(map(str, SIGMAS))} sigma": lambda r: _percent(r.errors.within_sigma),
    "at its stamp": lambda r: (
        _percent(r.errors.within_sigma_at_stamp) if r.method.startswith("frame") else "-"
    ),
}
_SETTLING: dict[str, Callable[[MethodResult], str]] = {
    "settled within 10 %: median / worst [ms]": lambda r: "{:.0f} / {:.0f}".format(*(r.settling_ms or ()))
}


def _load_table(load: LoadCase, results: Results) -> str:
    """Return the table of one load."""
    columns = _COLUMNS if load.begins_ns is None else _COLUMNS | _SETTLING
    rows = [[cell(result) for cell in columns.values()] for result in results.values()]
    return f"### {load.title}\n\n{table(list(columns), rows)}"


def _age_table(results: Results) -> str:
    """Return the ages of the forces, which are the same under every load."""
    cells = [
        [
            result.method,
            f"{result.errors.age_ms:.1f}",
            "{:.1f} / {:.1f}".format(*result.errors.age_held_ms),
            f"{result.errors.lag_ms:.1f}",
        ]
        for result in results.values()
        if result.order == "lo_shu"
    ]
    return table(["publish", "age when sent [ms]", "held p50 / p99 [ms]", "lag on the walk [ms]"], cells)


def body(
    size: Size,
    loads: dict[str, LoadCase],
    results: dict[str, Results],
    points: Sequence[OperatingPoint],
    sizes: Sequence[OperatingPoint],
) -> str:
    """Return the page: question, method, tables and findings."""
    quick = "**Quick run: one stride, few phases and sizes. The figures are not those of the study.**\n\n"
    step_ms, lead_ms = (time_ns * 1e-6 for time_ns in pace(400))
    tables = "\n\n".join(_load_table(load, results[name]) for name, load in loads.items())
    return f"""
{quick if size.strides == 1 else ""}How old is a force when a consumer uses it, and how large is its error?
`publish: frame` sends one force per scan, valid for the middle of the scan; `publish: element` sends one after every
conversion, predicted to the time of sending. Six legs share a bus of {BUS_HZ // 1000} kHz with
{HOST_COST_NS // 1000} us of the host per transaction, at 400 S/s: a conversion every {step_ms:.2f} ms, a ninth of the
shortest scan by `firmware_interface/schedule.py`. A force is sent {lead_ms:.2f} ms after the middle of its last
conversion. Feet with gap contact, converters with noise and steps, a tare of eight scans; alignment and network are
those of the daemon. States, fault detection and drift tracking are left out.

For comparison: scans whose elements count as simultaneous (skew left in), and elements that are extrapolated one by
one, along the line or parabola through their last readings, instead of by the filter over all nine.

{_age_table(results["measured_walk"])}

*Held*: at any time, of the last force sent. The age of a prediction is that of its newest reading; the other eight are
older, by up to a scan. *Lag*: shift of the truth that fits the held force best.

Errors are rms against the true force at the time of sending, or at any time for the *held* force; directions are of
feet loaded with 0.1 N and more. Sigma: share of components with an error within 1, 2, 3, 5 sigma, of feet in contact;
68 / 95 / 100 / 100 if Gaussian. The force of a whole scan is valid for its middle: *at its stamp* has its error at that
time. Walks: {len(loads["measured_walk"].truth.feet)} legs over {size.strides} strides. Steps and ramps:
{len(loads["step"].truth.feet)} feet, four directions of 0.65 to 0.8 N at {size.phases} phases of the scan, over 0.6 s
that begin 0.1 s before the first load.

{tables}

{_findings(results)}

### Rate, averaging, size of the network

The measured walk by Lo-Shu, and a foot that stands under 0.5 N. Rows with other numbers of weights than the first are
networks trained with {size.cases} loads in {size.training_steps} steps, as on the page
[How many weights](#how-many-weights), which also gives their run time: microseconds, against milliseconds of a
conversion.

{grid_table([*points, *sizes])}

![]({FIGURE})

The numbers beside the circles are averaged scans. {_averaging(points)}

On CAN, six legs send `Force` and `Quality` of at most {FRAME_BITS} bits each. {_can(points)}
"""


def _findings(results: dict[str, Results]) -> str:
    """Return the findings of the main tables."""
    walk, left, step = (results[name] for name in ("measured_walk", "sideways", "step"))
    frame, element = walk["frame", "lo_shu"].errors, walk["element", "lo_shu"].errors
    lines, parabolas = (walk[f"element, by {curve}", "lo_shu"].errors for curve in ("lines", "parabolas"))
    skewed = "frame, skew left in"
    settling = {
        method: f"{(step[method, 'lo_shu'].settling_ms or (0.0,))[0]:.0f} ms"
        for method in ("frame", "element", skewed)
    }

    def orders(of: Results, method: str) -> str:
        by_lo_shu, by_row = (of[method, order].errors.error_total_mn for order in ("lo_shu", "raster"))
        return f"{by_lo_shu:.0f} mN against {by_row:.0f}"

    return f"""- **Walk.** When sent, each force of one conversion errs by {element.error_total_mn:.0f} mN, each of
  a whole scan by {frame.error_total_mn:.0f}; held, {element.held_total_mn:.0f} against {frame.held_total_mn:.0f}. The
  gain is age: fz changes most, and errs by {element.error_mn[2]:.0f} instead of {frame.error_mn[2]:.0f} mN. The
  direction gains nothing, {element.direction_deg[0]:.1f} deg against {frame.direction_deg[0]:.1f} when sent: it depends
  on shear, a small difference of large closures, where a prediction errs more than an interpolation.
- **Filter.** Single elements extrapolated along lines err by {lines.error_total_mn:.0f} mN, along parabolas by
  {parabolas.error_total_mn:.0f}, because the errors of the elements are then independent.
- **Step.** No method knows the load before all elements have been read, and extrapolation rings afterwards: parabolas
  over whole scans are within a tenth after {settling["frame"]}, the filter after {settling["element"]}, scans with the
  skew left in after {settling[skewed]}.
- **Sigma** of a prediction holds at the time of sending: {_percent(element.within_sigma)} % on the walk. Sigma of a
  whole scan holds at its middle, {_percent(frame.within_sigma_at_stamp)} %, and when the force is sent for
  {_percent(frame.within_sigma)} %: a consumer has to add the change of the load since then.
- **Order.** With aligned elements it hardly matters. Lo-Shu against row by row, when sent: whole scans
  {orders(walk, "frame")} ahead and {orders(left, "frame")} to the left, single elements {orders(walk, "element")} and
  {orders(left, "element")}. With the skew left in it matters, {orders(walk, skewed)}: Lo-Shu cancels the apparent tilt
  of an even load that grows, but a leaning foot is not loaded evenly."""


def _averaging(points: Sequence[OperatingPoint]) -> str:
    """Return the effect of averaging and rate."""
    fastest, slowest = (pick(point.rate_sps for point in points) for pick in (max, min))
    scans = [p for p in points if p.rate_sps == fastest and p.publish == "frame"]
    one, most = scans[0], scans[-1]
    text = f"""Averaging {most.average_scans} scans at {fastest} S/s lowers the noise from {one.noise_mn:.2f} to
{most.noise_mn:.2f} mN and raises the error on the walk from {one.walk.held_total_mn:.0f} to
{most.walk.held_total_mn:.0f}."""
    if slowest < fastest:
        slow = next(p for p in points if p.rate_sps == slowest and p.publish == "frame")
        text += f""" Converting at {slowest} instead of {fastest} S/s gives {slow.noise_mn:.2f} mN and
{slow.walk.held_total_mn:.0f}."""
        less = next((p for p in scans if p.noise_mn <= slow.noise_mn), None)
        if less is not None:
            text += f""" Averaging is better than slow converters: {less.average_scans} scans at {fastest} S/s have
{less.noise_mn:.2f} mN at {less.walk.age_held_ms[0]:.0f} ms, one at {slowest} S/s {slow.noise_mn:.2f} mN at
{slow.walk.age_held_ms[0]:.0f} ms."""
    return text + " The error on a walk is limited by age, not by noise."


def _can(points: Sequence[OperatingPoint]) -> str:
    """Return the load of both publish modes on CAN."""
    fastest = max(point.rate_sps for point in points)
    frame, element = (
        next(p.can_kbit_s for p in points if p.rate_sps == fastest and p.publish == publish)
        for publish in ("frame", "element")
    )
    return f"""At {fastest} S/s whole scans take {frame:.0f} kbit/s; single conversions take {element:.0f} kbit/s,
{element / 500:.0%} of 500 kbit/s, which cannot carry them, and {element / 1000:.0%} of 1 Mbit/s."""
