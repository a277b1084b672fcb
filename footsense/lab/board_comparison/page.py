"""Section of a page of the report: age, price and error of boards and networks, as picture, table and words."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FormatStrFormatter, NullFormatter

from footsense.lab.board_comparison.windows import LOADED_N
from footsense.lab.report import Values, spread, table

#: Titles of the loads that judge a network.
LOADS = {
    "rest": "loads at rest",
    "walk": "measured walk",
    "trot": "trot of a robot dog",
    "random": "random gaits",
}
#: Changes of the board that the page puts into words, by their keys.
_STEPS_OF_BOARDS = (
    ("one_bus", "two_buses"),
    ("two_buses", "ad7147_one_bus"),
    ("ad7147_one_bus", "ad7147_two_buses"),
)
#: Ticks of the picture: ages [ms], errors [deg].
_AGE_TICKS_MS, _ERROR_TICKS_DEG = (5, 10, 20), (0.2, 0.5, 1, 2, 5, 10, 20)
#: Colours of the picture, by key of the board.
_COLOURS = {
    "one_bus": "tab:blue",
    "two_buses": "tab:red",
    "ad7147_one_bus": "tab:orange",
    "ad7147_two_buses": "tab:green",
}


def _marker_size(weights: int) -> float:
    return 4.0 + 0.07 * float(np.sqrt(weights))


def draw_boards(values: Values) -> Figure:
    """Return the picture: error over age, a colour for each board, a size of the marker for each network."""
    figure = Figure(figsize=(11.0, 8.5), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True).ravel()
    for axes, (load, title) in zip(panels, LOADS.items(), strict=True):
        for key, board in values["boards"].items():
            for network in values["networks"]:
                errors = np.array(network["direction_deg"][key][load])
                released = network["channels"] is None
                axes.errorbar(
                    board["mean_age_ms"],
                    errors.mean(),
                    [[errors.mean() - errors.min()], [errors.max() - errors.mean()]],
                    fmt="*" if released else "o",
                    markersize=13.0 if released else _marker_size(network["weights"]),
                    color=_COLOURS[key],
                    markerfacecolor=_COLOURS[key] if released else "none",
                    elinewidth=1.0,
                    capsize=2.5,
                )
        axes.set_title(title, fontsize=10)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(4.0, 20.0)
        axes.set_xticks(_AGE_TICKS_MS)
        axes.set_yticks(
            [tick for tick in _ERROR_TICKS_DEG if axes.get_ylim()[0] <= tick <= axes.get_ylim()[1]]
        )
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(FormatStrFormatter("%g"))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(visible=True, alpha=0.3)
    colours = [
        Line2D([], [], color=_COLOURS[key], lw=4.0, label=f"{board['title']}, {board['price_usd']:.0f} USD")
        for key, board in values["boards"].items()
    ]
    sizes = [
        Line2D(
            [],
            [],
            color="black",
            lw=0.0,
            marker="*" if network["channels"] is None else "o",
            markersize=13.0 if network["channels"] is None else _marker_size(network["weights"]),
            markerfacecolor="black" if network["channels"] is None else "none",
            label=f"{'released, ' * (network['channels'] is None)}{network['weights']} weights",
        )
        for network in values["networks"]
    ]
    figure.legend(
        handles=colours, loc="outside lower left", ncols=2, fontsize=9, title="board, chips of a foot"
    )
    figure.legend(
        handles=sizes,
        loc="outside lower right",
        ncols=2,
        fontsize=9,
        title="network; bars: best and worst start",
    )
    for axes in panels[2:]:
        axes.set_xlabel("age of the newest readings at sending, mean over the elements [ms]", fontsize=9)
    for axes in panels[::2]:
        axes.set_ylabel("direction error, mean [deg]", fontsize=9)
    return figure


def _steps_text(values: Values) -> str:
    """Return what each step to another board, or to a larger network, changes."""
    boards, networks = values["boards"], values["networks"]

    def change(before: Values, after: Values, key_before: str, key_after: str) -> str:
        return ", ".join(
            f"{title} {np.mean(before['direction_deg'][key_before][load]):.2f} to "
            f"{np.mean(after['direction_deg'][key_after][load]):.2f} deg"
            for load, title in LOADS.items()
        )

    lines = []
    for key_before, key_after in _STEPS_OF_BOARDS:
        before, after = boards[key_before], boards[key_after]
        moved = change(networks[-1], networks[-1], key_before, key_after)
        lines.append(
            f"- {before['title']} ({before['price_usd']:.0f} USD) to {after['title']} ({after['price_usd']:.0f} USD), "
            f"released networks: readings of {before['mean_age_ms']:.1f} to {after['mean_age_ms']:.1f} ms, mean age; "
            f"{moved}."
        )
    least, largest = networks[0], networks[-2]
    moved = change(least, largest, "ad7147_two_buses", "ad7147_two_buses")
    lines.append(
        f"- {boards['ad7147_two_buses']['title']}, {least['weights']} to {largest['weights']} weights: "
        f"{least['six_legs_us']:.0f} to {largest['six_legs_us']:.0f} us; {moved}."
    )
    return "\n".join(lines)


def boards_text(values: Values) -> str:
    """Return the first section of the page."""
    boards, networks = values["boards"], values["networks"]
    rows = [
        (
            board["title"],
            "released" if network["channels"] is None else network["channels"],
            network["weights"],
            f"{board['sent_after_ms']:.1f}",
            f"{board['scan_ms']:.1f}",
            f"{network['six_legs_us']:.0f}",
            board["n_chips"],
            f"{board['price_usd']:.0f}",
            *(
                spread(errors) if len(errors) > 1 else f"**{errors[0]:.2f}**"
                for errors in (network["direction_deg"][key][load] for load in LOADS)
            ),
        )
        for key, board in boards.items()
        for network in networks
    ]
    bought = table(
        "board, buses of 400 kHz | channels | weights | sent after [ms] | scan [ms] | six legs [us] | chips"
        " | price [USD] | " + " | ".join(f"{title} [deg]" for title in LOADS.values()),
        rows,
    )
    without = boards["ad7147_two_buses"]["without_force_rel"]
    return f"""
## What a millisecond and a dollar buy

Six legs, {values["host_cost_us"]} us of the host for a transaction, the fastest rate that the buses carry, simulated.
*Sent after*: from the middle of the newest conversion to the sending of its force, without the computing. *Six legs*: a
call of the network as the service makes it, one thread, median. Prices are planning values of the chips in a foot, for
tens of pieces and no quotations. What all parts of board `ad7147` come to is in `bill-of-materials.csv` of
`footsense lab fabricate`. A further bus adds an adapter to the robot, with board `fdc1004` a TCA9548A too, and nothing
to a foot. On one bus the six AD7147 are behind a TCA9548A as well: they have four addresses.

Networks of each size are trained alike for {values["steps"]} steps, {values["n_seeds"]} starts of each; in **bold**
is the released network, a single one, which was trained longer and with gaits of walking robots too. Each is judged at
the pace, noise and range of each board, by loads that are the same for all boards: direction, mean over the loads (in
gaits from {LOADED_N} N on); then mean, standard deviation and worst of the starts. The response table of the training
made the readings, with exact gains.

{bought}

![Direction error over the age of the readings, by board and network](speed-error.png)

The age in the picture and below is that of the elements' newest readings at sending, mean over the elements: *sent
after*, and half the time from the first conversion of a scan to its last. Errors below are means over the starts.

{_steps_text(values)}

Without a force, as more elements are beyond the converter's range than may be, {boards["ad7147_two_buses"]["title"]}:
{without["rest"]:.1%} of the loads at rest, {without["random"]:.1%} of the time in random gaits.
"""
