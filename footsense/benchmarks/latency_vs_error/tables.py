"""What the study `tradeoff` found, in tables and words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from footsense.benchmarks.latency_vs_error.chain import BUS_HZ, HOST_COST_NS, pace
from footsense.benchmarks.latency_vs_error.errors import SIGMAS, Judged
from footsense.benchmarks.latency_vs_error.grid import FRAME_BITS, Point, grid_table
from footsense.benchmarks.latency_vs_error.loads import Scene
from footsense.lab.studies.page import table

FIGURE = "tradeoff.png"


class Tried(NamedTuple):
    """How much the study tries.

    Attributes:
        strides: Strides of a walk that are counted.
        phases: Phases of a scan at which a foot is pressed.
        rates_sps: Conversions per second.
        averaged: Numbers of scans that are averaged.
        channels: Channels of the networks that are trained.
        cases: Loads that they learn from.
        training_steps: Steps in which they do.
    """

    strides: int
    phases: int
    rates_sps: tuple[int, ...]
    averaged: tuple[int, ...]
    channels: tuple[int, ...]
    cases: int
    training_steps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One way to publish, on one load.

    Attributes:
        way: Its name.
        order: Order of the scan.
        errors: What it was worth.
        settled_ms: On a pressed foot, time until the consumer's force is right to a tenth, median and worst [ms].
    """

    way: str
    order: str
    errors: Judged
    settled_ms: tuple[float, float] | None


def _percent(shares: tuple[float, ...]) -> str:
    return " / ".join(f"{100 * share:.0f}" for share in shares)


def _scene_table(scene: Scene, rows: Sequence[Row]) -> str:
    """Return the table of one load."""
    sigmas = " / ".join(map(str, SIGMAS))
    header = [
        "publish, order",
        "fx / fy / fz [mN]",
        "total [mN]",
        "direction mean / p95 [deg]",
        "held: total [mN]",
        "direction [deg]",
        f"% within {sigmas} sigma",
        "as of its stamp",
    ]
    if scene.begins_ns is not None:
        header.append("right to 10 %: median / worst [ms]")
    cells = []
    for row in rows:
        e = row.errors
        cells.append(
            [
                f"{row.way}, {row.order}",
                " / ".join(f"{value:.0f}" for value in e.sent_mn),
                f"{e.sent_total_mn:.0f}",
                f"{e.direction_deg[0]:.1f} / {e.direction_deg[1]:.1f}",
                f"{e.used_total_mn:.0f}",
                f"{e.used_direction_deg:.1f}",
                _percent(e.within_sigma),
                _percent(e.within_sigma_then) if row.way.startswith("frame") else "-",
            ]
        )
        if row.settled_ms is not None:
            cells[-1].append(f"{row.settled_ms[0]:.0f} / {row.settled_ms[1]:.0f}")
    return f"### {scene.title}\n\n{table(header, cells)}"


def _age_table(rows: Sequence[Row]) -> str:
    """Return how old forces are, which is the same on every load."""
    cells = [
        [
            row.way,
            f"{row.errors.age_ms:.1f}",
            f"{row.errors.age_used_ms[0]:.1f} / {row.errors.age_used_ms[1]:.1f}",
            f"{row.errors.behind_ms:.1f}",
        ]
        for row in rows
        if row.order == "lo_shu"
    ]
    return table(["publish", "age when sent [ms]", "in use p50 / p99 [ms]", "behind on the walk [ms]"], cells)


def body(
    tried: Tried,
    loads: dict[str, Scene],
    rows: dict[str, list[Row]],
    points: Sequence[Point],
    sizes: Sequence[Point],
) -> str:
    """Return what was asked, the tables, and what they say."""
    tables = "\n\n".join(_scene_table(scene, rows[name]) for name, scene in loads.items())
    quick = "**Quick run: one stride, few phases and sizes. The figures are not those of the study.**\n\n"
    bus = f"{BUS_HZ // 1000} kHz, {HOST_COST_NS // 1000} us of the host for a transaction"
    step_ms, lead_ms = (time_ns * 1e-6 for time_ns in pace(400))
    return f"""
{quick if tried.strides == 1 else ""}How old is a force when it is used, and how wrong? Forces of whole scans, as of
their middle (`publish: frame`), against one after every conversion, predicted to the time of sending
(`publish: element`). Six legs on one bus of {bus}, 400 S/s: a conversion every {step_ms:.2f} ms, a ninth of the
shortest scan by `firmware_interface/schedule.py`. A force is sent {lead_ms:.2f} ms after the middle of the conversion
that it ends with: half a conversion and the tolerance of the slowest chip, then the start of the next one, the question
whether all are done, and the read-out of all legs. Feet with gap contact, converters with noise and steps, a tare of
eight scans; the daemon's own code makes the forces, by the shipped network. States, fault finding and the tracking of
the zero are left out.

For comparison: scans whose elements are taken to be of one time (skew left in), and elements that each go on by
themselves, along the line or parabola through their last readings, instead of by the filter over all nine.

{_age_table(rows["measured_walk"])}

*In use*: at any time, by a consumer that holds the last force. The age of a prediction is that of its newest reading;
the other eight are older, by up to a scan. *Behind*: by how much earlier the truth has to be taken to fit best to what
the consumer holds.

In the tables, errors are rms against what the foot feels when the force is sent; *held* is against what it feels at any
time, the consumer holding the last force; directions on feet loaded with 0.1 N and more. Sigma: share of components
whose error is within 1, 2, 3, 5 of it, on feet on the ground; Gaussian would be 68 / 95 / 100 / 100. A force of a whole
scan speaks of its middle: *as of its stamp* has its error at that time. Walks: {len(loads["measured_walk"].truth.feet)}
legs, strides counted: {tried.strides}. Steps and ramps: {len(loads["step"].truth.feet)} feet, four directions of 0.65
to 0.8 N at {tried.phases} phases of the scan, over 0.6 s that begin 0.1 s before the first load.

{tables}

{_findings(rows)}

### Rate, averaging, size of the network

The measured walk by Lo-Shu, and a foot that stands under 0.5 N. Rows with other numbers of weights than the first are
networks that learnt {tried.cases} loads in {tried.training_steps} steps, as on the page
[How many weights](#how-many-weights), which also tells what they take: microseconds, nothing beside a conversion.

{grid_table([*points, *sizes])}

![]({FIGURE})

The numbers beside the circles are averaged scans. {_lessons(points)}

On CAN, six legs send `Force` and `Quality` of at most {FRAME_BITS} bits each. {_can(points)}
"""


def _findings(rows: dict[str, list[Row]]) -> str:
    """Say what the main tables tell."""
    walk, left, step = (
        {(row.way, row.order): row for row in rows[name]} for name in ("measured_walk", "sideways", "step")
    )
    frame, element = walk["frame", "lo_shu"].errors, walk["element", "lo_shu"].errors
    lines, parabolas = (walk[f"element, by {way}", "lo_shu"].errors for way in ("lines", "parabolas"))
    settled = {way: _settled(step[way, "lo_shu"]) for way in ("frame", "element", "frame, skew left in")}

    def orders(of: dict[tuple[str, str], Row], way: str) -> str:
        by_lo_shu, by_row = (of[way, order].errors.sent_total_mn for order in ("lo_shu", "raster"))
        return f"{by_lo_shu:.0f} mN against {by_row:.0f}"

    return f"""- **On a walk** a force after every conversion errs by {element.sent_total_mn:.0f} mN when it is sent,
  that of a whole scan by {frame.sent_total_mn:.0f}; in use {element.used_total_mn:.0f} against
  {frame.used_total_mn:.0f}. The gain is age: fz, which moves most, errs by {element.sent_mn[2]:.0f} instead of
  {frame.sent_mn[2]:.0f} mN. The direction, {element.direction_deg[0]:.1f} deg against {frame.direction_deg[0]:.1f}
  when sent, gains nothing: it hangs on shear, a small difference of large closures, and a prediction errs more in it
  than a parabola that mostly interpolates.
- **The filter** makes that possible: along lines it would be {lines.sent_total_mn:.0f} mN, along parabolas
  {parabolas.sent_total_mn:.0f}, because each element then errs by itself.
- **After a step** nobody knows the load before all elements have been read, and whatever looks at the past then
  swings: parabolas over whole scans are right to a tenth after {settled["frame"]} ms, the filter after
  {settled["element"]}, scans with the skew left in after {settled["frame, skew left in"]}.
- **Sigma** of a prediction is for the time of sending: {_percent(element.within_sigma)} % there on the walk. That of a
  whole scan is for its middle, {_percent(frame.within_sigma_then)} %; when the force is sent it is
  {_percent(frame.within_sigma)} %. Who uses it later has to add what the load may have done since.
- **The order** hardly matters once the skew is removed. Lo-Shu against row by row, when sent: whole scans
  {orders(walk, "frame")} ahead and {orders(left, "frame")} to the left, single elements {orders(walk, "element")} and
  {orders(left, "element")}. With the skew left in it matters much, {orders(walk, "frame, skew left in")}: Lo-Shu
  cancels the tilt that an even load fakes while it grows, but a foot that leans is not loaded evenly."""


def _settled(row: Row) -> str:
    """Return the median time after which a force is right to a tenth [ms]."""
    return "-" if row.settled_ms is None else f"{row.settled_ms[0]:.0f}"


def _lessons(points: Sequence[Point]) -> str:
    """Say what averaging and rate are worth."""
    fastest = max(point.rate_sps for point in points)
    scans = [p for p in points if p.rate_sps == fastest and p.publish == "frame"]
    one, most = scans[0], scans[-1]
    slow = min((p for p in points if p.average_scans == 1 and p.publish == "frame"), key=lambda p: p.rate_sps)
    text = f"""Averaging {most.average_scans} scans at {fastest} S/s lowers the noise from {one.noise_mn:.2f} to
{most.noise_mn:.2f} mN and raises the error on the walk from {one.walk.used_total_mn:.0f} to
{most.walk.used_total_mn:.0f}."""
    if slow.rate_sps < fastest:
        text += f""" Converting at {slow.rate_sps} instead of {fastest} S/s gives {slow.noise_mn:.2f} mN and
{slow.walk.used_total_mn:.0f}."""
        quieter = next((p for p in scans if p.noise_mn <= slow.noise_mn), None)
        if quieter is not None:
            text += f""" Averaging beats slower converters: {quieter.average_scans} scans at {fastest} S/s have
{quieter.noise_mn:.2f} mN at {quieter.walk.age_used_ms[0]:.0f} ms, one at {slow.rate_sps} S/s {slow.noise_mn:.2f} mN at
{slow.walk.age_used_ms[0]:.0f} ms."""
    return text + " Noise is never what limits a walk; age is."


def _can(points: Sequence[Point]) -> str:
    """Say which publish mode a bus carries."""
    fastest = max(point.rate_sps for point in points)
    frame, element = (
        next(p for p in points if p.rate_sps == fastest and p.publish == way) for way in ("frame", "element")
    )
    return f"""At {fastest} S/s whole scans take {frame.can_kbit_s:.0f} kbit/s; single conversions
{element.can_kbit_s:.0f} kbit/s, {element.can_kbit_s / 500:.0%} of 500 kbit/s, which cannot carry them, and
{element.can_kbit_s / 1000:.0%} of 1 Mbit/s."""
