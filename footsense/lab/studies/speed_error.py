"""Page `speed-error`: age and price of the boards, time of network and cycle, and rates of publishing against error."""

from msgspec.structs import replace

from footsense.benchmarks.cycle import (
    N_WARM_UP_CYCLES,
    compare_cycle_durations,
    network_durations_us,
    simulated_walk_frames,
)
from footsense.benchmarks.latency_vs_error import measure_latency_vs_error
from footsense.benchmarks.scan import CONFIGURATIONS, newest_reading_age_ms, scan_period_ms
from footsense.config import DEFAULT, SMALL_BOARD
from footsense.foot.network_card import NETWORK_FILE
from footsense.frames import ELEMENTS, LEGS
from footsense.lab.fabrication.electronics import CHIPS
from footsense.lab.report import StudyContext, Values, target_at_most

TITLE = "Speed against error"

#: Calls of a network, and cycles of the service, that are timed.
_N_CALLS, _N_CYCLES = 2000, 800
#: Time of the host for a transaction [us].
HOST_COST_US = 40
#: Robots of six legs by board and number of buses. On one bus the AD7147 are behind a multiplexer, too.
_ROBOTS = CONFIGURATIONS | {
    "ad7147_one_bus": replace(DEFAULT, buses=SMALL_BOARD.buses),
    "ad7147_two_buses": DEFAULT,
}
#: Limits of the targets: network, six legs [us]; whole cycle over the time between two frames [1], by robot.
_WANTED_NETWORK_US = 90.0
_WANTED_CYCLE_REL = {"ad7147_two_buses": 0.12, "one_bus": 0.12}


#: Scenes in which boards are timed and forces published.
_TIMED_SCENES = ("hanging", "measured_walk", "tripod")


def compute(context: StudyContext) -> Values:
    """Measure age, price and cycle of the boards, and rates of converting and publishing."""
    for name in _TIMED_SCENES:
        context.scene(name)
    published = measure_latency_vs_error(context)
    context.report_progress("rates done")
    boards = {key: _board(key, quick=context.quick) for key in _ROBOTS}
    network_file = context.files(NETWORK_FILE) / NETWORK_FILE
    (six_legs_us,) = network_durations_us([network_file], len(LEGS), 50 if context.quick else _N_CALLS)
    held_mn = next(
        point["walk"]["held_error_norm_rms_mn"]
        for point in published["points"]
        if (point["rate_sps"], point["publish_every"]) == (400, 4)
    )
    return {
        "boards": boards,
        "network": {"weights": context.network.card["training"]["weights"], "six_legs_us": six_legs_us},
        "published": published,
        "targets": [
            target_at_most("network, six legs, p50", [_WANTED_NETWORK_US], [six_legs_us], "{:.0f} us"),
            *(
                target_at_most(
                    f"{board['board']}: whole cycle over the time between two frames, p50",
                    [_WANTED_CYCLE_REL[key]],
                    [board["cycle_us"] / board["frame_us"]],
                    "{:.3f}",
                )
                for key, board in boards.items()
                if key in _WANTED_CYCLE_REL
            ),
            target_at_most(
                "measured walk, error at any time of the last force sent, default rates, rms",
                [35],
                [held_mn],
                "{:.0f} mN",
            ),
        ],
    }


def _board(key: str, *, quick: bool) -> Values:
    """Return parts, price and times of a board on its buses."""
    config = _ROBOTS[key]
    scan_ms, sent_after_ms = scan_period_ms(config, HOST_COST_US), newest_reading_age_ms(config)["p50"]
    step_ms = scan_ms / config.scan_plan.n_conversions
    found: Values = {
        "title": f"{config.board}, {('one bus', 'two buses')[len(config.buses) - 1]}",
        "board": config.board,
        "n_chips": len(CHIPS[config.board]),
        "price_usd": sum(chip.price_usd for chip in CHIPS[config.board]),
        "sent_after_ms": sent_after_ms,
        "scan_ms": scan_ms,
        "mean_age_ms": sent_after_ms + 0.5 * (ELEMENTS - 1) * step_ms,
        "frame_us": 1e6 / config.frames_hz,
    }
    if key in _WANTED_CYCLE_REL:
        frames = simulated_walk_frames(N_WARM_UP_CYCLES + (50 if quick else _N_CYCLES), config)
        found["cycle_us"] = compare_cycle_durations(frames, config)["p50"]
    return found
