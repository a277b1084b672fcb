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
from footsense.lab.report import StudyContext, Values

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
#: Robots whose whole cycle is timed.
_TIMED = ("ad7147_two_buses", "one_bus")


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
    return {
        "boards": boards,
        "network": {"weights": context.network.card["training"]["weights"], "six_legs_us": six_legs_us},
        "published": published,
    }


def shown(values: Values) -> Values:
    """Return the cycles over the time between two frames, and the walk at the default rates."""
    return {
        "cycle_rel": {
            key: values["boards"][key]["cycle_us"] / values["boards"][key]["frame_us"] for key in _TIMED
        },
        "walk": next(
            point["walk"]
            for point in values["published"]["points"]
            if (point["rate_sps"], point["publish_every"]) == (400, 4)
        ),
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
    if key in _TIMED:
        frames = simulated_walk_frames(N_WARM_UP_CYCLES + (50 if quick else _N_CYCLES), config)
        found["cycle_us"] = compare_cycle_durations(frames, config)["p50"]
    return found
