"""Page `real-sensors`: sensors that others measured, as witnesses of what is assumed of rubber, gains and drift."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from footsense.calibration.parameter_fit import PRIOR_SIGMA
from footsense.calibration.twin import GAIN
from footsense.frames import Vector
from footsense.lab.measured.insole import (
    FULL_SCALE_BAR,
    MAX_JUMP_COUNTS,
    InsoleFit,
    Session,
    estimated_pressure,
    fit_published,
    fit_reading,
    memory_states,
    predicted_reading,
    pressure_on_clock,
    published_regressors,
    read_sessions,
)
from footsense.lab.report import StudyContext, Values, spread, table
from footsense.sim.rubber import CREEP_REL, ViscoelasticRubber

TITLE = "Real sensors: what others measured, against what is assumed here"

#: Where the data are to be had, by their folder in that of `--data`; a study without this needs none.
DATA = {
    "insole": "github.com/ami-iit/paper_belli_2023_sensors_insole-calibration, Data/left_insole, BSD-3",
    "eflesh": "github.com/notvenky/eFlesh, each recording of characterization/datasets, MIT",
}
_CALIBRATION = "calibration"
#: The calibrations in words.
_CALIBRATIONS = {"static": "no memory", "published": "published", "ours": "ours"}
#: Bins of the pressure in which a loop is measured, and samples in each branch of three of them, at least.
_N_BINS, _MIN_SAMPLES = 20, 5
#: Standard deviation of a normal distribution over its median absolute deviation.
_SIGMA_PER_MAD = 1.4826
#: Samples of a block; every other block makes a half of a session.
_N_BLOCK = 20
#: Time at both ends of a recording of eFlesh in which it is unloaded [s], and what its force gauge shows then, at most.
_END_S, _MAX_FREE = 20.0, 5.0
#: Rubber of the simulation: creep and play over what it assumes.
_INSOLE, _RUBBER = "the insole", "`sim/rubber.py`"
_RUBBERS = {_RUBBER: (1.0, 1.0), "its play x 3": (1.0, 3.0), "its creep and play x 3": (3.0, 3.0)}


def compute(context: StudyContext) -> Values:
    """Fit the insole's sessions, judge its first calibration in later ones, and read the drift of eFlesh."""
    folder = context.data_folder(DATA)
    sessions = read_sessions(folder / "insole")
    means = {name: one.reading.mean(axis=1) for name, one in sessions.items()}
    fits = {name: fit_reading(one, means[name]) for name, one in sessions.items()}
    context.report_progress("sessions fitted")
    first, fitted = sessions[_CALIBRATION], fits[_CALIBRATION]
    own = [fit_reading(first, one, clock=fitted.clock) for one in first.reading.T]
    # The foam is one: all elements have the memory of their mean.
    ours, static = (
        [fit_reading(first, one, clock=fitted.clock, memory=memory) for one in first.reading.T]
        for memory in (fitted.memory, np.zeros_like(fitted.memory))
    )
    pressure = pressure_on_clock(first, fitted.clock)
    theirs = [fit_published(one, pressure) for one in first.reading.T]
    context.report_progress("elements fitted")
    everything = read_sessions(folder / "insole", np.inf)
    readings = everything[_CALIBRATION].reading.T
    all_ours = [fit_reading(first, one, clock=fitted.clock, memory=fitted.memory) for one in readings]
    later = {name: one for name, one in sessions.items() if name != _CALIBRATION}
    gains = {name: _gains(one, ours, fits[name].clock) for name, one in later.items()}
    loops = {_INSOLE: _loop(pressure, means[_CALIBRATION])}
    for name, factors in _RUBBERS.items():
        loops[name] = _loop(pressure, _rubber_reading(pressure, first.step_s, *factors))
    context.drawings["real-sensors.png"] = _figure(loops, gains)
    return {
        "n_elements": first.reading.shape[1],
        "range_counts": float(np.ptp(means[_CALIBRATION])),
        "forms": {name: _form_figures(one, means[name], fits[name]) for name, one in sessions.items()},
        "element_creep": [fit.memory[-1] for fit in own],
        "loops": {
            name: {"largest": float(np.abs(loop).max()), "mean": float(np.abs(loop).mean())}
            for name, (_, loop) in loops.items()
        },
        "gains": {name: _gain_figures(one, ours, fits[name].clock) for name, one in later.items()},
        "n_elements_of_all": everything[_CALIBRATION].reading.shape[1],
        "gains_of_all": {name: _gain_figures(everything[name], all_ours, fits[name].clock) for name in later},
        "later": {
            name: _later_figures(one, (fitted.clock, fits[name].clock), gains[name], (static, ours), theirs)
            for name, one in later.items()
        },
        "eflesh": {path.name: _eflesh_figures(path) for path in sorted((folder / "eflesh").glob("*/"))},
    }


def _form_figures(session: Session, mean: Vector, fit: InsoleFit) -> Values:
    """Return what each form leaves of the mean reading over its range, and the memory of the last."""
    none = np.zeros_like(fit.memory)
    forms = {
        "static": fit_reading(session, mean, memory=none, clock=np.zeros(2)),
        "clock": fit_reading(session, mean, memory=none),
        "memory": fit,
    }
    left = {name: float(one.misfit.std() / np.ptp(mean)) for name, one in forms.items()}
    return left | {
        "play": float(fit.memory[:-1].sum()),
        "creep": float(fit.memory[-1]),
        "clock_s": fit.clock[0],
    }


def _gains(
    session: Session, fits: Sequence[InsoleFit], clock: Vector, rows: slice | Vector = slice(None)
) -> Vector:
    """Return slope [1] and offset [counts] of each element's readings over those that its fit expects, shape (2, n)."""
    pressure = pressure_on_clock(session, clock)
    states = memory_states(pressure, session.step_s)
    expected = [predicted_reading(fit, pressure, states)[rows] for fit in fits]
    pairs = zip(expected, session.reading[rows].T, strict=True)
    return np.array([np.polyfit(one, reading, 1) for one, reading in pairs]).T


def _gain_figures(session: Session, fits: Sequence[InsoleFit], clock: Vector) -> Values:
    """Return the elements' gains against the first session: common, spread of single ones, and of two halves."""
    gain = _gains(session, fits, clock)[0]
    block = np.arange(len(session.reading)) // _N_BLOCK
    halves = [_gains(session, fits, clock, block % 2 == half)[0] for half in (0, 1)]
    own = gain / np.median(gain)
    return {
        "common": float(np.median(gain)),
        "deviation": _robust_deviation(own),
        "low": float(np.percentile(own, 5)),
        "high": float(np.percentile(own, 95)),
        # Half of the samples have twice the variance, and their difference four times.
        "by_chance": _robust_deviation(halves[0] / halves[1]) / 2.0,
    }


def _later_figures(
    session: Session,
    clocks: tuple[Vector, Vector],
    gain_and_offset: Vector,
    fits: tuple[Sequence[InsoleFit], Sequence[InsoleFit]],
    theirs: Sequence[Vector],
) -> Values:
    """Return rms errors over full scale of the pressure that the first session's calibrations find in another one.

    Returns:
        By calibration (`static`, `published`, `ours`), of the median element and of the mean of all elements: with the
        first session's clock and gains (`raw`), with the session's own clock (`clock`), and with both its own (`all`).
    """
    gain, offset = gain_and_offset
    readings = {False: session.reading, True: (session.reading - offset) / gain}
    figures: Values = {}
    for name in ("static", "published", "ours"):
        figures[name] = {}
        for level, clock, refitted in (
            ("raw", clocks[0], False),
            ("clock", clocks[1], False),
            ("all", clocks[1], True),
        ):
            reading = readings[refitted]
            if name == "published":
                pairs = zip(reading.T, theirs, strict=True)
                found = np.array([published_regressors(one) @ coefficients for one, coefficients in pairs]).T
            else:
                found = estimated_pressure(fits[name == "ours"], reading, session.step_s)
            pressure = pressure_on_clock(session, clock)
            error = found - pressure[:, None]
            rms = np.sqrt(np.square(error).mean(axis=0))
            together = float(np.sqrt(np.square(error.mean(axis=1)).mean()))
            figures[name][level] = {"element": float(np.median(rms)), "mean": together}
    return figures


def _loop(pressure: Vector, reading: Vector) -> tuple[Vector, Vector]:
    """Return pressures, and by how much the reading is larger after the largest pressure, over its range [1]."""
    falling = np.arange(len(pressure)) > np.argmax(pressure)
    place = np.digitize(pressure, np.linspace(pressure.min(), pressure.max(), _N_BINS + 1)[1:-1])
    middles, loop = [], []
    for n in range(1, _N_BINS - 1):
        near = np.abs(place - n) <= 1
        branches = [near & ~falling, near & falling]
        if min(int(one.sum()) for one in branches) < _MIN_SAMPLES:
            continue
        middle = float(pressure[place == n].mean())
        up, down = (np.polyval(np.polyfit(pressure[one] - middle, reading[one], 1), 0.0) for one in branches)
        middles.append(middle)
        loop.append((down - up) / np.ptp(reading))
    return np.array(middles), np.array(loop)


def _rubber_reading(pressure: Vector, step_s: float, creep: float, play: float) -> Vector:
    """Return the effective load of the simulated rubber on a history of the pressure, whose full scale is 1 N."""
    rubber, up = ViscoelasticRubber(creep, play), np.array([0.0, 0.0, 1.0])
    loads = [rubber.next_effective_load(round(n * step_s * 1e9), up, p * up) for n, p in enumerate(pressure)]
    return np.array([force_n[2] for _, force_n in loads])


def _robust_deviation(values: Vector) -> float:
    return float(_SIGMA_PER_MAD * np.median(np.abs(values - np.median(values))))


def _eflesh_figures(folder: Path) -> Values:
    """Return by how much the unloaded reading of a recording moved from begin to end, over its largest change."""
    sensor, states = (np.loadtxt(folder / f"{name}.csv", delimiter=",") for name in ("sensor", "states"))
    t_s, channels = sensor[:, 0] - sensor[0, 0], sensor[:, 1:]
    free = np.interp(sensor[:, 0], states[:, 0], states[:, -1]) < _MAX_FREE
    begin, end = (np.median(channels[free & near], axis=0) for near in (t_s < _END_S, t_s > t_s[-1] - _END_S))
    signal = np.linalg.norm(channels - begin, axis=1).max()
    return {
        "minutes": t_s[-1] / 60.0,
        "drift": float(np.linalg.norm(end - begin) / signal),
        "n_channels": len(begin),
    }


def text(values: Values) -> str:
    """Return the page's Markdown."""
    gains, everything, loops = values["gains"], values["gains_of_all"], values["loops"]
    deviations = [one["deviation"] for one in gains.values()]
    creep = [one["creep"] for one in values["forms"].values()]
    forms = table(
        "session | no memory [%] | and the clock [%] | and memory [%] | play [%] | creep of 10 s [%]",
        [
            (
                name,
                *(f"{100 * one[key]:.2f}" for key in ("static", "clock", "memory")),
                f"{100 * one['play']:.0f}",
                f"{100 * one['creep']:.0f}",
            )
            for name, one in values["forms"].items()
        ],
    )
    loop_rows = [
        (name, f"{100 * one['largest']:.1f}", f"{100 * one['mean']:.1f}") for name, one in loops.items()
    ]
    gain_rows = [
        (
            name,
            f"{one['common']:.3f}",
            f"{100 * one['deviation']:.1f}",
            f"{one['low']:.2f} to {one['high']:.2f}",
            f"{100 * one['by_chance']:.1f}",
            f"{100 * everything[name]['deviation']:.1f}",
        )
        for name, one in gains.items()
    ]
    later_rows = [
        (
            f"{name}, {words}",
            *(
                f"{100 * one[level][which]:.1f}"
                for level in ("raw", "clock", "all")
                for which in ("element", "mean")
            ),
        )
        for name, calibrations in values["later"].items()
        for words, one in ((_CALIBRATIONS[key], one) for key, one in calibrations.items())
    ]
    eflesh_rows = [
        (name, one["n_channels"], f"{one['minutes']:.1f}", f"{100 * one['drift']:.1f}")
        for name, one in values["eflesh"].items()
    ]
    eflesh = (
        table("recording | channels | minutes | drift [% of the signal]", eflesh_rows)
        if eflesh_rows
        else "Not given to this run."
    )
    assumed = [
        (
            "a foot's own creep of 10 s",
            f"{100 * CREEP_REL[-1]:.0f} %",
            f"{100 * min(creep):.0f} to {100 * max(creep):.0f} %",
            "no: too little, for foam",
        ),
        (
            "loop, largest, on the same history",
            f"{100 * loops[_RUBBER]['largest']:.1f} %",
            f"{100 * loops[_INSOLE]['largest']:.1f} %",
            "no: too narrow, for foam; play x 3 is wide enough",
        ),
        (
            "gains of elements, prior of a calibration",
            f"{100 * PRIOR_SIGMA[GAIN][0]:.0f} %",
            f"{100 * min(deviations):.1f} to {100 * max(deviations):.1f} %",
            "nearly",
        ),
        (
            "gains of elements, sigma of uncalibrated feet",
            "1 %",
            "the same",
            "no: too little after a session",
        ),
        (
            "form: chain and play",
            "exact",
            f"leaves {100 * values['forms'][_CALIBRATION]['memory']:.2f} % of {100 * values['forms'][_CALIBRATION]['clock']:.2f} %",
            "yes",
        ),
    ]
    return f"""
No sensor here is a foot of ours. Each figure has its caveat: the insole's dielectric is **foam**, not rubber; it lies
in a **pressure chamber**, not under a ball; its readings have **8 bits**, and {values["range_counts"]:.0f} of 256 steps
are its full scale ({FULL_SCALE_BAR:g} bar); the sessions are of more than one day, and the insole **may have been mounted
anew** between them; the pressure has **no times**, so an offset and a rate of its clock are fitted. Data: {DATA["insole"]}
(Belli et al., Sensors 23, 4501, 2023), of which {values["n_elements"]} of 280 elements follow the pressure in all
sessions without jumps of over {MAX_JUMP_COUNTS:g} steps; {values["n_elements_of_all"]} with them.

{table("assumption | assumed | measured | supported", assumed)}

## Loop and creep

Of the mean of all elements, in the session of the calibration, one slow staircase up and down: reading while the pressure
falls over that while it rises, largest and mean over the pressure, in % of full scale. The rubber has the same history, its
1 N at full scale.

{table("sensor | largest [%] | mean [%]", loop_rows)}

![](real-sensors.png)

What three forms leave of the mean reading, rms, in % of its range: a cubic of the pressure; with the pressure's clock;
with our form's memory, play of three widths and a creep of 10 s. Steps of the staircase last about 10 s, so play and creep
are **weakly told apart**, and a creep of 1 s or less not at all from the clock. The creep of single elements,
each fitted alone, is {spread([100 * one for one in values["element_creep"]], 0)} %: its spread is mostly that of fits to
8 bits, and no measure of elements that creep differently.

{forms}

## Gains in later sessions

Slope of each element's reading over what its fit in the first session expects: median of all (*common*), and robust standard
deviation (1.48 times the median absolute deviation) and 5 to 95 % of the single ones over it. *By chance* is what two halves of the same session tell.
The last column is of all {values["n_elements_of_all"]} elements; a scene's `gain_rel` of 4 % is
the worst of it.

{table("session | common | deviation [%] | 5 to 95 % | by chance [%] | with jumps [%]", gain_rows)}

## One calibration in later sessions

Error of the pressure found from the readings with the first session's calibration, rms in % of full scale, of the median
element and of the mean of all: *as calibrated*; with the session's own clock; and with gain and offset of each element
refitted too. *Published* is the form of Belli et al., a cubic and powers of 40 past readings, fitted anew by us; *ours* a cubic of each
element with the memory of their mean. A part of these errors is the offset, which a foot of ours loses by taring.

{table("session, calibration | as calibrated, element | mean | own clock, element | mean | gain, offset, clock, element | mean", later_rows)}

## Unloaded reading of eFlesh

Magnetic, no capacitance: its unloaded channels at the end of a recording against those at its begin, over the largest change under load
({DATA["eflesh"]}). It is pressed meanwhile; temperature is not recorded.

{eflesh}
"""


def _figure(loops: Mapping[str, tuple[Vector, Vector]], gains: Mapping[str, Vector]) -> Figure:
    """Return the figure of loops over pressure, and of gains by session."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, (pressure, loop) in loops.items():
        left.plot(100.0 * pressure, 100.0 * loop, label=name.strip("`"))
    left.set(xlabel="pressure [% of full scale]", ylabel="loop [% of full scale]")
    left.legend(fontsize="small")
    right.boxplot([100.0 * (one[0] / np.median(one[0]) - 1.0) for one in gains.values()])
    right.set(xticklabels=list(gains), ylabel="gain of an element [%]")
    right.tick_params(axis="x", rotation=20)
    return figure
