"""Study `touchdown`: latency from the touchdown of a foot to the frame that reports it, and false reports."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from footsense.benchmarks.latency_vs_error.chain import pace
from footsense.benchmarks.touchdown.run import ELEMENT, FRAME, METHODS, Run, run
from footsense.benchmarks.touchdown.touchdowns import CONTACT_N, TOUCHDOWNS, TREMOR_N, Mask, Steps, Vector
from footsense.lab.studies.page import Page, StudyContext, table

#: Feet of each manner, and length of the run [s].
_FULL, _QUICK = (6, 25.0), (2, 4.0)
#: Time after a touchdown in which the error counts [s].
_AFTER_S = 0.05
#: False reports in no occurrence, upper bound of a Poisson mean at 95 %.
_NONE_95 = 3
_SEED = 5
_FIGURE = "touchdown.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Latencies:
    """Latencies and error of one method in one manner of touchdown.

    Attributes:
        contact_ms: Latency of the flag CONTACT after each touchdown [ms], from a load of `CONTACT_N` on.
        force_ms: Latency of the first force above `CONTACT_N` [ms].
        error_mn: Error of the force along the leg in the time after a touchdown, rms [mN].
    """

    contact_ms: Vector
    force_ms: Vector
    error_mn: float


#: Latencies by manner of touchdown.
_ByKind = dict[str, Latencies]


def _first_ms(reported: Mask, sent_s: Vector, begins_s: Vector, crossed_s: Vector) -> Vector:
    """Return the latency of the first report of one foot, shape (frames,), after each touchdown [ms]."""
    first = [np.flatnonzero(reported & (sent_s > begin_s))[0] for begin_s in begins_s.tolist()]
    latencies_ms: Vector = 1e3 * (sent_s[first] - crossed_s)
    return latencies_ms


def _latencies(result: Run, steps: Steps, until_s: float, kind: int) -> Latencies:
    contact_ms, force_ms, squares_n2 = [], [], []
    for foot in np.flatnonzero(steps.kind == kind).tolist():
        complete = steps.crossed_s[foot] < until_s - 2 * _AFTER_S
        times = result.sent_s, steps.begins_s[foot, complete], steps.crossed_s[foot, complete]
        contact_ms.append(_first_ms(result.contact[:, foot], *times))
        force_ms.append(_first_ms(result.force_n[:, foot] > CONTACT_N, *times))
        error_n = result.force_n[:, foot] - result.true_force_n[:, foot]
        for crossed_s in times[2].tolist():
            after = (result.sent_s > crossed_s) & (result.sent_s < crossed_s + _AFTER_S)
            squares_n2.append(np.nanmean(error_n[after] ** 2))
    return Latencies(
        contact_ms=np.concatenate(contact_ms),
        force_ms=np.concatenate(force_ms),
        error_mn=1e3 * float(np.sqrt(np.mean(squares_n2))),
    )


def _false(reported: Mask, result: Run) -> str:
    """Return the number of false reports in swing, and of feet that have just lifted off."""
    begins = reported[1:] & ~reported[:-1] & (result.true_force_n[1:] == 0.0)
    swings = result.swings[1:]
    return f"{(begins & swings).sum()} / {(begins & ~swings).sum()}"


def _p50_p99(values_ms: Vector) -> str:
    return "{:.1f} / {:.1f}".format(*np.percentile(values_ms, (50, 99)))


def _figure(latencies: dict[str, _ByKind]) -> Figure:
    """Draw the share of reported touchdowns over the time since."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    lines = (
        (FRAME, "contact_ms", "tab:gray", "-"),
        (ELEMENT, "contact_ms", "tab:blue", "-"),
        (ELEMENT, "force_ms", "tab:blue", ":"),
    )
    for axis, speed in zip(axes, ("hard", "soft"), strict=True):
        for method, report, colour, style in lines:
            kinds = [kind for kind in TOUCHDOWNS if kind.startswith(speed)]
            all_ms = np.sort(np.concatenate([getattr(latencies[method][kind], report) for kind in kinds]))
            share = 100 * np.arange(1, len(all_ms) + 1) / len(all_ms)
            label = method if report == "contact_ms" else f"{method}, by its force"
            axis.step(all_ms, share, style, where="post", color=colour, label=label)
        axis.set(title=f"{speed} touchdowns", xlabel=f"time since {1e3 * CONTACT_N:g} mN [ms]", xlim=(0, 45))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("reported touchdowns [%]")
    axes[0].legend(fontsize=8, loc="lower right")
    return figure


def _swing_row(method: str, result: Run) -> list[str]:
    hours = float(np.gradient(result.sent_s) @ result.swings.sum(axis=1)) / 3600
    return [
        method,
        f"{60 * hours:.1f}",
        _false(result.contact, result),
        _false(result.force_n > CONTACT_N, result),
        f"{_NONE_95 / hours:.0f}",
        f"{1e3 * np.nanmax(result.force_n[result.swings]):.1f}",
    ]


def page(bench: StudyContext) -> Page:
    """Run the study on the released network, or its quick form."""
    n_feet, until_s = _QUICK if bench.quick else _FULL
    steps = Steps(n_feet, until_s, np.random.default_rng(_SEED))
    runs: dict[str, Run] = {}
    latencies: dict[str, _ByKind] = {}
    for method in METHODS:
        runs[method] = run(bench, method, steps, until_s, _SEED)
        latencies[method] = {
            name: _latencies(runs[method], steps, until_s, kind) for kind, name in enumerate(TOUCHDOWNS)
        }
        bench.say(f"touchdown: {method}")
    values = {
        method: {
            name: {
                "contact_ms": np.percentile(of.contact_ms, (50, 99)).round(2).tolist(),
                "force_ms": np.percentile(of.force_ms, (50, 99)).round(2).tolist(),
                "error_mn": of.error_mn,
            }
            for name, of in by_kind.items()
        }
        for method, by_kind in latencies.items()
    }
    return Page(
        name="touchdown",
        title="Touchdown: element by element, scan by scan",
        body=_body(runs, latencies, quick=bench.quick),
        figures={_FIGURE: _figure(latencies)},
        values={"contact_n": CONTACT_N, "latencies": values},
    )


def _median_ms(by_kind: _ByKind, report: str) -> str:
    return f"{np.median(np.concatenate([getattr(of, report) for of in by_kind.values()])):.1f}"


def _body(runs: dict[str, Run], latencies: dict[str, _ByKind], *, quick: bool) -> str:
    """Return the page: question, method, tables and findings."""
    step_ms, lead_ms = (time_ns * 1e-6 for time_ns in pace(400))
    after_ms, contact_mn = 1e3 * _AFTER_S, 1e3 * CONTACT_N
    frame, element = latencies[FRAME], latencies[ELEMENT]
    error_mn = {
        method: f"{np.mean([of.error_mn for of in by_kind.values()]):.0f} mN"
        for method, by_kind in latencies.items()
    }
    header = ["touchdown", "read", "Contact p50 / p99 [ms]", f"fz > {contact_mn:g} mN [ms]", "error rms [mN]"]
    rows = [
        [kind, method, _p50_p99(of.contact_ms), _p50_p99(of.force_ms), f"{of.error_mn:.0f}"]
        for kind in TOUCHDOWNS
        for method, of in ((method, latencies[method][kind]) for method in METHODS)
    ]
    swing_header = [
        "read",
        "minutes of swing",
        "false Contact",
        f"fz > {contact_mn:g} mN",
        "rate below [1/h], if none",
        "largest fz [mN]",
    ]
    short = "**Quick run: few feet and steps. The figures are not those of the study.**\n\n" if quick else ""
    return f"""
{short}How soon after a touchdown does a consumer know of it? {len(frame[next(iter(TOUCHDOWNS))].contact_ms)} touchdowns
of each manner: to 0.5 N within 5 ms, or as softly as a step of the walk, to 1 N in 144 ms; in the middle of the ball,
or 25 degrees beside it on any side. Legs are read by whole scans (`publish: frame`) or by single elements
(`publish: element`). A conversion every {step_ms:.2f} ms, sent {lead_ms:.2f} ms after its middle, bounds the latency
from below: {lead_ms:.1f} ms, and {lead_ms + step_ms / 2:.1f} ms on average. The daemon's own pipeline and the shipped
network, converters with noise and steps, a drift of 20 K in ten minutes, and in swing a tremor of
{1e3 * TREMOR_N:g} mN after every step of a neighbour (an assumption).

Latency counts from a load of {contact_mn:g} mN, the threshold, to the frame with the flag `Contact`, or with a force
above the threshold. Error: of fz within {after_ms:g} ms after it, at the time of sending.

{table(header, rows)}

![]({_FIGURE})

False reports, of feet without load: in swing / in the first 0.1 s after lift-off. None in so much swing bounds the rate
by the given value, at 95 %.

{table(swing_header, [_swing_row(method, result) for method, result in runs.items()])}

Median latency of the flag over all manners: {_median_ms(frame, "contact_ms")} ms by whole scans,
{_median_ms(element, "contact_ms")} ms by single elements. The flag is set as soon as the filter predicts the load from
the first element that shows it, except in the first 0.1 s after lift-off, in which the prediction rings; the force
alone, which rings then, exceeds the threshold after {_median_ms(element, "force_ms")} ms. In the first {after_ms:g} ms
the force errs by {error_mn[ELEMENT]} by single elements, by {error_mn[FRAME]} by whole scans.
"""
