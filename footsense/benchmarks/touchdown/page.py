"""Study `touchdown`: how soon a consumer learns that a foot has met the ground, and how often wrongly."""

from dataclasses import asdict, dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.benchmarks.latency_vs_error.chain import pace
from footsense.benchmarks.touchdown.run import (
    ELEMENT,
    FRAME,
    KINDS,
    SHAKE_N,
    TOUCH_N,
    WAYS,
    Run,
    Steps,
    run,
)
from footsense.lab.studies.page import Page, Workbench, table

Vector = NDArray[np.float64]

#: Feet of each kind and time that they walk [s].
_FULL, _QUICK = (6, 25.0), (2, 4.0)
#: Time after a touchdown in which the force is judged [s].
_AFTER_S = 0.05
_SEED = 5
_FIGURE = "touchdown.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What one way to read was worth for one kind of touchdown.

    Attributes:
        contact_ms: Every latency of the flag CONTACT [ms], from the first `TOUCH_N` that the foot carries.
        force_ms: The same of the first force that says so [ms].
        error_mn: Error of the force along the leg in the time after, rms [mN].
    """

    contact_ms: list[float]
    force_ms: list[float]
    error_mn: float


def _latencies_ms(seen: NDArray[np.bool_], result: Run, begins_s: Vector, crossed_s: Vector) -> list[float]:
    """Return how long after each touchdown something was seen of one foot [ms], shape of `seen` (frames,)."""
    sent_s = result.sent_s
    first = [np.flatnonzero(seen & (sent_s > begin_s)) for begin_s in begins_s]
    return [float(1e3 * (sent_s[at[0]] - crossed)) for at, crossed in zip(first, crossed_s, strict=True)]


def _judge(result: Run, steps: Steps, until_s: float, kind: int) -> Found:
    contact_ms, force_ms, squares_n2 = [], [], []
    for foot in np.flatnonzero(steps.kind == kind).tolist():
        over = steps.crossed_s[foot] < until_s - 2 * _AFTER_S
        times = steps.begins_s[foot, over], steps.crossed_s[foot, over]
        contact_ms += _latencies_ms(result.contact[:, foot], result, *times)
        force_ms += _latencies_ms(result.force_n[:, foot] > TOUCH_N, result, *times)
        error_n = result.force_n[:, foot] - result.true_force_n[:, foot]
        for crossed_s in times[1]:
            after = (result.sent_s > crossed_s) & (result.sent_s < crossed_s + _AFTER_S)
            squares_n2.append(np.nanmean(error_n[after] ** 2))
    return Found(contact_ms=contact_ms, force_ms=force_ms, error_mn=1e3 * float(np.sqrt(np.mean(squares_n2))))


def _false(seen: NDArray[np.bool_], result: Run) -> str:
    """Return how often something began to be seen in swing, and of feet that had just lifted off."""
    begun = seen[1:] & ~seen[:-1] & (result.true_force_n[1:] == 0.0)
    swings = result.swings[1:]
    return f"{(begun & swings).sum()} / {(begun & ~swings).sum()}"


def _spread(values_ms: list[float]) -> str:
    p50, p99 = np.percentile(values_ms, (50, 99))
    return f"{p50:.1f} / {p99:.1f}"


def _figure(found: dict[str, dict[str, Found]]) -> Figure:
    """Draw the share of touchdowns that are known over the time since."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    colours = dict(zip(WAYS, ("tab:gray", "tab:blue"), strict=True))
    for axis, speed in zip(axes, ("hard", "soft"), strict=True):
        for way in WAYS:
            kinds = [kind for kind in KINDS if kind.startswith(speed)]
            for seen, style in (("contact_ms", "-"), ("force_ms", ":")):
                if way == FRAME and seen == "force_ms":
                    continue
                all_ms = np.sort(np.concatenate([getattr(found[way][kind], seen) for kind in kinds]))
                share = np.arange(1, len(all_ms) + 1) / len(all_ms)
                label = way if seen == "contact_ms" else f"{way}, by its force"
                axis.step(all_ms, 100 * share, style, where="post", color=colours[way], label=label)
        axis.set(title=f"{speed} touchdowns", xlabel=f"time since {1e3 * TOUCH_N:g} mN [ms]", xlim=(0, 45))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("known to a consumer [%]")
    axes[0].legend(fontsize=8, loc="lower right")
    return figure


def _rows(found: dict[str, dict[str, Found]]) -> list[list[str]]:
    return [
        [kind, way, _spread(one.contact_ms), _spread(one.force_ms), f"{one.error_mn:.0f}"]
        for kind in KINDS
        for way, one in ((way, found[way][kind]) for way in WAYS)
    ]


def _swing_rows(runs: dict[str, Run]) -> list[list[str]]:
    rows = []
    for way, result in runs.items():
        hours = float(np.gradient(result.sent_s) @ result.swings.sum(axis=1)) / 3600
        rows.append(
            [
                way,
                f"{60 * hours:.1f}",
                _false(result.contact, result),
                _false(result.force_n > TOUCH_N, result),
                f"{3 / hours:.0f}",
                f"{1e3 * np.nanmax(result.force_n[result.swings]):.1f}",
            ]
        )
    return rows


def page(bench: Workbench) -> Page:
    """Return the page."""
    n_feet, until_s = _QUICK if bench.quick else _FULL
    steps = Steps(n_feet, until_s, np.random.default_rng(_SEED))
    runs, found = {}, {}
    for way in WAYS:
        runs[way] = run(bench, way, steps, until_s, _SEED)
        found[way] = {name: _judge(runs[way], steps, until_s, n) for n, name in enumerate(KINDS)}
        bench.say(f"touchdown: {way}")
    return Page(
        name="touchdown",
        title="Touchdown: element by element, scan by scan",
        body=_body(runs, found, quick=bench.quick),
        figures={_FIGURE: _figure(found)},
        values={"touch_n": TOUCH_N, "found": {way: _plain(found[way]) for way in WAYS}},
    )


def _plain(found: dict[str, Found]) -> dict[str, dict[str, object]]:
    return {
        kind: asdict(one)
        | {
            "contact_ms": np.percentile(one.contact_ms, (50, 99)).round(2).tolist(),
            "force_ms": np.percentile(one.force_ms, (50, 99)).round(2).tolist(),
        }
        for kind, one in found.items()
    }


def _median_ms(found: dict[str, Found], seen: str) -> float:
    return float(np.median(np.concatenate([getattr(one, seen) for one in found.values()])))


def _body(runs: dict[str, Run], found: dict[str, dict[str, Found]], *, quick: bool) -> str:
    """Return what was asked, the tables, and what they say."""
    step_ms, lead_ms = (time_ns * 1e-6 for time_ns in pace(400))
    after_ms, touch_mn = 1e3 * _AFTER_S, 1e3 * TOUCH_N
    scan_ms, element_ms = (f"{_median_ms(found[way], 'contact_ms'):.1f}" for way in WAYS)
    by_force_ms = f"{_median_ms(found[ELEMENT], 'force_ms'):.1f}"
    scan_mn, element_mn = (f"{np.mean([one.error_mn for one in found[way].values()]):.0f}" for way in WAYS)
    n_each = len(found[FRAME][next(iter(KINDS))].contact_ms)
    header = ["touchdown", "read", "Contact p50 / p99 [ms]", f"fz > {touch_mn:g} mN [ms]", "error rms [mN]"]
    swing_header = [
        "read",
        "minutes of swing",
        "false Contact",
        f"fz > {touch_mn:g} mN",
        "rate below [1/h], if none",
        "largest fz [mN]",
    ]
    short = "**Quick run: few feet and steps. The figures are not those of the study.**\n\n" if quick else ""
    return f"""
{short}How soon is a consumer told that a foot has met the ground? {n_each} touchdowns of each kind: within 5 ms to
0.5 N, or as softly as a step of the walk, 1 N in 144 ms; in the middle of the ball, or 25 degrees beside it on any
side. Legs are read by whole scans (`publish: frame`) or by single elements (`publish: element`). A conversion every
{step_ms:.2f} ms, sent {lead_ms:.2f} ms after its middle: no way to read can tell sooner than {lead_ms:.1f} ms, or than
{lead_ms + step_ms / 2:.1f} ms on average. The daemon's own pipeline and the shipped network, converters with noise and
steps, a drift of 20 K in ten minutes, and in swing a tremor of {1e3 * SHAKE_N:g} mN after every step of a neighbour (an
assumption).

Latency from the moment at which the foot carries {touch_mn:g} mN, which is the threshold, to the frame that says so:
with the flag `Contact`, or by its force alone. Error: of fz within {after_ms:g} ms after it, at the time of sending.

{table(header, _rows(found))}

![]({_FIGURE})

False ones, of feet that carry nothing: in swing / in the first 0.1 s after lift-off. None in so much swing means fewer
than the given rate, at 95 %.

{table(swing_header, _swing_rows(runs))}

Median latencies of the flag over all kinds: {scan_ms} ms by whole scans, {element_ms} ms by single elements. The flag
is set as soon as the filter predicts the load from the first element that shows it, except in the first tenth of a
second after lift-off, in which its prediction rings; the force alone, which rings then, tells it after {by_force_ms}
ms. In the first {after_ms:g} ms the force is off by {element_mn} mN by single elements, by {scan_mn} mN by whole scans.
"""
