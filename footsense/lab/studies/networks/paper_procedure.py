"""Study `paper-procedure`: the paper's network on the paper's cases, over many start weights and two kinds of input.

Source:
    Aoyagi et al., section III F.
"""

from dataclasses import dataclass

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from footsense.foot.force_errors import ForceErrors, evaluate_force_errors
from footsense.lab.evaluation.evaluate import (
    PAPER_DIRECTION_DEG,
    PAPER_MAGNITUDE_GF,
    capacitance_based_force_estimator,
    elastance_based_force_estimator,
)
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.monte_carlo.statistics import MeanStd
from footsense.lab.plots import plot_band, subplot_row
from footsense.lab.training.load_cases import paper_training
from footsense.lab.training.paper.procedure import (
    EPOCHS,
    HIDDEN_NEURONS,
    QUICK_EPOCHS,
    NetworkInput,
    paper_networks,
    verification_cases,
)

#: Magnitudes of the 180 directions [gf]; the training cases have the first and the last, the paper's test the middle.
MAGNITUDES_GF = (50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0)
INDEX_OF_100_GF = MAGNITUDES_GF.index(100.0)

NETWORK_INPUT_LABELS: dict[NetworkInput, str] = {"capacitance": "ΔC", "closure": "closures"}


@dataclass(frozen=True, kw_only=True)
class NetworkInputErrors:
    """Errors of network and linear estimator for one kind of input.

    Attributes:
        network_direction_error_deg: Direction errors of the networks at each magnitude [deg].
        network_magnitude_error_gf: Magnitude errors of the networks at each magnitude [gf].
        linear_direction_error_deg: Direction error of the linear estimator at 100 gf [deg].
        linear_magnitude_error_gf: Magnitude error of the linear estimator [gf].
    """

    network_direction_error_deg: list[MeanStd]
    network_magnitude_error_gf: list[MeanStd]
    linear_direction_error_deg: float
    linear_magnitude_error_gf: float


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `paper-procedure`: errors by kind of input.

    Attributes:
        epochs: Training epochs.
        errors_by_network_input: For `capacitance` and `closure`.
    """

    epochs: int
    errors_by_network_input: dict[str, NetworkInputErrors]


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the errors of networks trained on capacitance changes and on closures, with a figure."""
    response = context.response
    tests = [verification_cases(response, magnitude_gf) for magnitude_gf in MAGNITUDES_GF]
    training = paper_training(response)
    linear = {
        "capacitance": capacitance_based_force_estimator(response.design, training),
        "closure": elastance_based_force_estimator(training),
    }
    errors_by_network_input, points = {}, {}
    for network_input, name in NETWORK_INPUT_LABELS.items():
        networks = paper_networks(response, quick=context.quick, network_input=network_input)
        rows = [
            [evaluate_force_errors(cases.force_n, read(cases.closure_um)) for read in networks]
            for cases in tests
        ]
        alone = evaluate_force_errors(
            tests[INDEX_OF_100_GF].force_n, linear[network_input](tests[INDEX_OF_100_GF].closure_um)
        )
        errors_by_network_input[str(network_input)] = NetworkInputErrors(
            network_direction_error_deg=[MeanStd.of_values(one.direction_deg for one in row) for row in rows],
            network_magnitude_error_gf=[MeanStd.of_values(one.magnitude_gf for one in row) for row in rows],
            linear_direction_error_deg=alone.direction_deg,
            linear_magnitude_error_gf=alone.magnitude_gf,
        )
        points[str(network_input)] = rows[INDEX_OF_100_GF]
        context.report_progress(f"paper-procedure: {len(networks)} networks on {name} trained")
    results = Results(
        epochs=QUICK_EPOCHS if context.quick else EPOCHS, errors_by_network_input=errors_by_network_input
    )
    return results, {"paper-procedure.png": _figure(errors_by_network_input, points)}


def _figure(
    errors_by_network_input: dict[str, NetworkInputErrors], points: dict[str, list[ForceErrors]]
) -> Figure:
    """Return the figure of magnitude over direction error per network, and of direction error over force."""
    figure, (cloud, curve) = subplot_row(2, 8.2, 4.0)
    for colour, (network_input, name) in zip(("C0", "C1"), NETWORK_INPUT_LABELS.items(), strict=True):
        networks, found = points[network_input], errors_by_network_input[network_input]
        x, y = [one.direction_deg for one in networks], [one.magnitude_gf for one in networks]
        cloud.plot(x, y, "o", color=colour, alpha=0.6, label=f"networks on {name}")
        label = f"linear on {name}"
        cloud.plot(
            found.linear_direction_error_deg,
            found.linear_magnitude_error_gf,
            "X",
            color=colour,
            mec="k",
            ms=9,
            label=label,
        )
        plot_band(
            curve, MAGNITUDES_GF, found.network_direction_error_deg, color=colour, label=f"networks on {name}"
        )
    cloud.plot(PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF, "k*", ms=13, label="the paper")
    cloud.set(xscale="log", yscale="log", title="180 directions at 100 gf")
    cloud.set(xlabel="mean direction error [deg]", ylabel="mean magnitude error [gf]")
    for axis in (cloud.xaxis, cloud.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    for training_gf, label in ((MAGNITUDES_GF[0], "training cases"), (MAGNITUDES_GF[-1], "_")):
        curve.axvline(training_gf, color="k", ls=":", label=label)
    curve.set(title="the same directions, other forces", ylim=(0.0, None))
    curve.set(xlabel="force [gf]", ylabel="mean direction error [deg]")
    for axes in (cloud, curve):
        axes.legend(fontsize=8)
    return figure


STUDY = Study(
    name="paper-procedure",
    title="The paper's own procedure",
    compute=compute,
    template_names={"HIDDEN_NEURONS": HIDDEN_NEURONS},
    uses_network=False,
)
