"""Study `tolerance`: which tolerances turn the paper's simulated error into its measured one.

The paper measured 15.9 deg and 18.7 gf where it had simulated 2.4 deg and 5.3 gf, and left open why. Here hundreds of
feet are drawn, and read by read-outs trained on the design and by read-outs trained on their own cases.

Source:
    Aoyagi et al., section V.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from footsense.lab.evaluation.evaluate import PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF
from footsense.lab.monte_carlo.resumable_run import Tolerances, Workers, in_turn
from footsense.lab.monte_carlo.sweeps import (
    CAREFUL,
    EXACT,
    FEET,
    FULL,
    QUICK,
    TEST_STANDS,
    TYPICAL,
    Plan,
    Sweep,
    SweepResults,
    sweep_results,
)
from footsense.lab.monte_carlo.workers import parallel
from footsense.lab.studies.page import Figures, Study, StudyContext, plot_band, table

#: The paper's mean errors on its fabricated sensor (section V C) [deg, gf].
MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF = 15.9, 18.7
#: Read-outs by the names of `specimens.judge`: trained on the design, and trained on the foot.
ON_DESIGN = {"network": "released network", "plain": "network on ΔC", "change": "linear on ΔC"}
ON_FOOT = {"own_network": "network on ΔC", "own_change": "linear on ΔC", "own_closure": "linear on closures"}
_OWN_LINEAR = {"own_change": "ΔC", "own_closure": "closures"}
_FEET_FIGURE, _STAND_FIGURE = "tolerance-feet.png", "tolerance-test-stand.png"
_COLOURS = {
    "network": "C0",
    "plain": "C3",
    "change": "C1",
    "own_network": "C3",
    "own_change": "C1",
    "own_closure": "C2",
}


def _reached(results: SweepResults, sweep: Sweep, name: str, target: float) -> str:
    """Return the level at which a target is reached, or the error at the largest level."""
    level = results.reached(sweep, name, target)
    if level is not None:
        return f"{level:.2g}" if level else "at once"
    return f"no ({results.means(sweep, name)[-1]:.1f} at {sweep.levels[-1]:g})"


def _reached_table(results: SweepResults, sweeps: tuple[Sweep, ...], readouts: dict[str, str]) -> str:
    """Return the table of the levels at which each imperfection gives the paper's measured errors."""
    header = ["imperfection", *(f"{label}: {MEASURED_DIRECTION_DEG} deg at" for label in readouts.values())]
    header += [f"{label}: {MEASURED_MAGNITUDE_GF} gf at" for label in readouts.values()]
    rows = [
        [sweep.what]
        + [_reached(results, sweep, f"{name}_deg", MEASURED_DIRECTION_DEG) for name in readouts]
        + [_reached(results, sweep, f"{name}_gf", MEASURED_MAGNITUDE_GF) for name in readouts]
        for sweep in sweeps
    ]
    return table(header, rows)


def _level_table(
    results: SweepResults, sweeps: tuple[Sweep, ...], columns: dict[str, str], shares: tuple[str, ...] = ()
) -> str:
    """Return direction / magnitude errors at each level, mean over feet, and shares of components within sigma."""
    rows: dict[Tolerances, list[str]] = {}  # sweeps begin alike: such a row is shown once
    for sweep in sweeps:
        for level in results.plan.levels(sweep):
            row = ["as designed" if sweep.at(level) == EXACT else f"{sweep.what}: {level:g}"]
            for name in columns:
                direction = results.over_feet(sweep, level, f"{name}_deg")
                row.append(f"{direction} / {results.over_feet(sweep, level, f'{name}_gf').mean:.1f}")
            row += [f"{results.over_feet(sweep, level, name).mean:.0%}" for name in shares]
            rows.setdefault(sweep.at(level), row)
    labels = [f"{label} [deg / gf]" for label in columns.values()]
    return table(
        ["imperfection, rms", *labels, *(f"within {name[-1]} sigma" for name in shares)], list(rows.values())
    )


def _figure(results: SweepResults, sweeps: tuple[Sweep, ...], readouts: dict[str, str]) -> Figure:
    """Draw the mean direction error over the level of each imperfection, with the standard deviation between feet."""
    figure = Figure(figsize=(9.0, 5.8), layout="constrained")
    panels = figure.subplots(2, 3, sharey=True).ravel()
    for axes, sweep in zip(panels, sweeps, strict=False):
        levels = results.plan.levels(sweep)
        for name, label in readouts.items():
            statistics = [results.over_feet(sweep, level, f"{name}_deg") for level in levels]
            plot_band(axes, levels, statistics, color=_COLOURS[name], label=label)
        axes.axhline(MEASURED_DIRECTION_DEG, color="k", ls=":", label="the paper, measured")
        axes.set(xlabel=f"{sweep.what}, rms", ylim=(0.0, 45.0))
        axes.grid(alpha=0.3)
    for axes in panels[::3]:
        axes.set_ylabel("mean direction error [deg]")
    if len(sweeps) < len(panels):
        panels[-1].axis("off")
        panels[-1].legend(*panels[0].get_legend_handles_labels(), loc="center")
    else:
        panels[2].legend(fontsize=8)
    return figure


def _at_most(results: SweepResults, sweep: Sweep) -> str:
    """Return the errors of linear read-outs of a foot's own cases at the largest level, as a line."""
    level = sweep.levels[-1]
    ends = [
        f"{results.over_feet(sweep, level, f'{name}_deg')} deg on {on}" for name, on in _OWN_LINEAR.items()
    ]
    return f"  - {sweep.what}, {level:g}: " + ", ".join(ends)


def _met(results: SweepResults, sweep: Sweep, name: str) -> str:
    """Return the level at which a read-out has the paper's direction error, and its magnitude error there."""
    level = results.reached(sweep, f"{name}_deg", MEASURED_DIRECTION_DEG)
    if level is None:
        end = results.means(sweep, f"{name}_deg")[-1]
        return f"not up to {sweep.levels[-1]:g} ({end:.1f} deg there)"
    magnitude_gf = np.interp(level, results.plan.levels(sweep), results.means(sweep, f"{name}_gf"))
    return f"at {level:.2g} ({magnitude_gf:.1f} gf there)"


def _question(plan: Plan) -> str:
    """Return the part of the page with the question and the distribution of the feet."""
    return f"""
The paper simulated {PAPER_DIRECTION_DEG} deg / {PAPER_MAGNITUDE_GF} gf and measured {MEASURED_DIRECTION_DEG} deg /
{MEASURED_MAGNITUDE_GF} gf (section V). It supposes fabrication, above all the gaps, and gives no tolerance. How large
would it have to be? Two readings are possible:

1. **A read-out trained on the design reads a foot that differs.** Here: the released network on closures; on ΔC, the
   paper's kind of network and a linear read-out.
2. **A read-out trained on the foot's own cases meets the noise of its test stand.** Section V C describes this: 362
   measured training cases, 180 for verification. Here: the paper's kind of network and linear read-outs.

Of each level, {plan.feet} feet (reading 1) or {plan.with_network} (reading 2) were drawn: normal deviates of the stated
rms; gap, film and stray of each element for itself. Drawn again: feet with less than a quarter of a gap, of a film or of
the stiffness, and mounts that tilt beyond the response table. Errors are means over the 180 cases; ± is the standard
deviation between feet.
"""


def _on_design(results: SweepResults) -> str:
    """Return the part about read-outs trained on the design."""
    gap, stray = FEET[0], FEET[1]
    typical = (
        f"gap {TYPICAL.gap_um:g} um, film {TYPICAL.film_um:g} um, unknown stray {TYPICAL.stray_pf:g} pF, "
        f"stiffness {TYPICAL.stiffness_rel:.0%}, mount {TYPICAL.mount_deg:g} deg"
    )
    return f"""
### Reading 1: trained on the design

The rms level at which each imperfection alone causes the paper's measured error, interpolated linearly between
levels, or the error at the largest level:

{_reached_table(results, FEET, ON_DESIGN)}

![]({_FEET_FIGURE})

- **Gaps** of {results.gap_um:g} um by design. The paper's {MEASURED_DIRECTION_DEG} deg (and {MEASURED_MAGNITUDE_GF}
  gf), in um: linear on ΔC {_met(results, gap, "change")}, network on ΔC {_met(results, gap, "plain")}, released network
  on closures {_met(results, gap, "network")}. A closure follows without the gap; ΔC goes with its inverse square.
- **Stray** that the daemon does not know, in pF: released network {_met(results, stray, "network")}, linear on ΔC
  {_met(results, stray, "change")}. A closure needs the capacitance without stray; in ΔC it cancels.
- **Fitted anew**, linear, to the foot's own cases, exactly measured, at the largest level:
{chr(10).join(_at_most(results, sweep) for sweep in FEET)}

All levels, as direction / magnitude error. "Typical" is {typical}: assumed, these of the paper's foot are not
published.

{_level_table(results, FEET, ON_DESIGN, ("within_1", "within_2"))}

The last columns are the shares of the released network's force components within 1 and 2 of its stated sigma, which
holds for the designed foot. A normal error would have 68 % and 95 %.
"""


def _on_foot(results: SweepResults) -> str:
    """Return the part about read-outs trained on the foot."""
    stick = TEST_STANDS[3]
    careful = (
        f"{CAREFUL.reading_pf * 1e3:g} fF, {CAREFUL.repeat_rel:.0%}, {CAREFUL.reference_rel:g} resolutions, "
        f"{CAREFUL.stick_deg:g} deg"
    )
    columns = {name: f"{label}, own" for name, label in ON_FOOT.items()}
    return f"""
### Reading 2: trained on the foot

The test stand alone, with feet as designed: noise of each capacitance (the paper's meter resolves 1 fF), of each ΔC
relative to it (rubber creeps while nine elements are read one by one), of the reference force in resolutions of the
paper's sensor (4, 4, 12 gf, Table II), and of the stick: the angle between force and contact normal, zero when centred.
Then all of it on typical feet, "careful" being {careful}, assumed too.

{_reached_table(results, TEST_STANDS, ON_FOOT)}

![]({_STAND_FIGURE})

- **The stick**, in deg: network on ΔC {_met(results, stick, "own_network")}, linear on ΔC
  {_met(results, stick, "own_change")}, linear on closures {_met(results, stick, "own_closure")}; the released network,
  whose training has leaning contacts, {_met(results, stick, "network")}.
- **The reference** errs in the training cases and again in the verification cases: a perfect foot sensor would seem to
  have the errors of its column below. Its linearity, 1.5 % of the rated 4 kgf, is 60 gf. It is the same in both sets,
  so the read-outs fit it, and it is not in these figures.

{_level_table(results, TEST_STANDS, {**columns, "reference": "perfect sensor", "network": "released"})}

### What this says

Two measured numbers do not decide between the readings. The first needs a read-out from the design, which the paper
does not describe for its experiment. The second follows its text; there, constant deviations of fabrication are
mostly fitted, those from load to load are not. The distributions are assumed, feet differ from the design in
these five ways alone, and temperature, hysteresis and wear are not in them.
"""


def run_study(
    context: StudyContext, workers: Workers, file: Path | None = None
) -> tuple[SweepResults, Figures]:
    """Judge the feet of the full or the quick plan.

    Args:
        context: The models.
        workers: Run the jobs.
        file: As for `sweep_results`.
    """
    plan = QUICK if context.quick else FULL
    results = sweep_results(context.models, context.response.design.gap_um, plan, workers, file)
    context.say(
        f"tolerance: {plan.feet} feet at each level of fabrication, {plan.with_network} at each of the test stand"
    )
    figures = {
        _FEET_FIGURE: _figure(results, FEET, ON_DESIGN),
        _STAND_FIGURE: _figure(results, TEST_STANDS, ON_FOOT),
    }
    return results, figures


def compute(context: StudyContext) -> tuple[SweepResults, Figures]:
    """Judge the feet on this machine."""
    return run_study(context, in_turn if context.quick else parallel())


def render(results: SweepResults) -> str:
    """Return the page's text."""
    return _question(results.plan) + _on_design(results) + _on_foot(results)


STUDY = Study(
    name="tolerance",
    title="What fabrication and calibration cost",
    results=SweepResults,
    compute=compute,
    render=render,
)
