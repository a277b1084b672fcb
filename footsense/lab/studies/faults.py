"""Page `faults`: every fault that a scene can have, one walk each, and what CAN says of it."""

from msgspec.structs import replace

from footsense.config import DEFAULT
from footsense.foot.network_card import NETWORK_FILE
from footsense.frames import ELEMENTS, State
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.report import SAME_TABLE, StudyContext, Values, table
from footsense.lab.studies.boards.robots import robot_of
from footsense.validation.converter_kinds import (
    HANGS_AFTER,
    HOST_COST_US,
    N_SCANS,
    simulate_converter_kinds,
)
from footsense.validation.disturbance_table import (
    BEGINS_S,
    ENDS_S,
    STANDING_N,
    WANTED_SIGMAS,
    DisturbanceFigures,
    simulate_disturbances,
)
from footsense.validation.fault_table import ROBOTS, simulate_can_faults, simulate_leg_faults
from footsense.validation.fault_trial import BREAKS_AT_S, DURATION_S, LOAD, PASSES_AT_S, FaultFigures

TITLE = "Effect of every fault, and of disturbances"
#: Share of the errors that sigma has to cover.
_WANTED_SHARE = 0.95


def compute(context: StudyContext) -> Values:
    """Walk once with each fault; faults of CAN, which no foot changes, for the default foot only."""
    foot = context.foot_design
    context.scene("measured_walk")
    for board in ROBOTS:
        robot_of(context, board)
    folder = context.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)
    other = foot.foot_type != DEFAULT.foot_type
    load = replace(LOAD, peak_force_n=0.5 * foot.loads.max_n)
    foot_type = str(folder.resolve()) if other else DEFAULT.foot_type
    legs, small = (
        simulate_leg_faults(
            context.report_progress, board, quick=context.quick, foot_type=foot_type, load=load
        )
        for board in ROBOTS
    )
    disturbed = simulate_disturbances(
        context.report_progress, quick=context.quick, foot_type=foot_type, max_n=foot.loads.max_n
    )
    kinds = {} if other else simulate_converter_kinds(context.report_progress, quick=context.quick)
    can = {} if other else simulate_can_faults(context.report_progress, quick=context.quick)
    return {
        "peak_vertical_force_n": load.peak_force_n,
        "leg_faults": {fault: _named(found) for fault, found in legs.items()},
        "small_board": {fault: _named(found) for fault, found in small.items()},
        "disturbances": {
            words: {scene: _named(found) for scene, found in of_scenes.items()}
            for words, of_scenes in disturbed.items()
        },
        "converter_kinds": {
            kind: {clock: figures._asdict() for clock, figures in by_clock.items()}
            for kind, by_clock in kinds.items()
        },
        "can_faults": {fault: found._asdict() for fault, found in can.items()},
    }


def _named(found: FaultFigures | DisturbanceFigures) -> Values:
    return found._asdict() | {"state": found.state.name.lower(), "cause": found.cause.name.lower()}


def text(values: Values) -> str:
    """Return the page's Markdown."""
    legs, small = (
        table(
            f"fault, {SAME_TABLE} | state | cause | elements | detection [ms] | recovery [ms] | others' gap [ms] | lost | error/sigma"
            " | others' error [mN]",
            [_leg_row(fault, found) for fault, found in values[board].items()],
        )
        for board in ("leg_faults", "small_board")
    )
    return f"""
Each row is a walk of {DURATION_S:g} s in virtual time through the whole service, with feet `{values["foot"]}` of board
`ad7147`, six legs on two buses without a multiplexer, and up to {values["peak_vertical_force_n"]:g} N on a foot, with a fault on one leg
from {BREAKS_AT_S:g} s, in the middle of its stance, to {PASSES_AT_S:g} s. Each is one walk: times of rare faults depend
on its draws. *Detection* is the time from the fault to the first frame that shows it, *recovery* the time from its end
to the leg's next `Valid` force that stays. *Others' gap* is the longest time between two forces of any other leg, and
*lost* how many frames fewer they had than in a walk without a fault; a frame is a scan. *Error/sigma* is
the leg's largest error over its own sigma while the fault shows, *others' error* the largest of any other leg from the
fault on.

{legs}

The row *nothing* is a walk without a fault: its error, the largest of any leg, is that at a hard touchdown. A leg whose
cable was off is tared again in its next swing. A leg that holds its bus stops the two beside it: nothing disconnects
it. An element that has drifted has another baseline at the end of the drift,
and is used again after a tare.

## Rows and columns behind one FDC1004

The same with board `fdc1004`, six legs on one bus, whose frames are conversions of 2.7 ms. Its rows are lines that are
switched. A leg that held the bus is tried again after a second at the earliest, because each try costs the others a
timeout.

{small}

{_disturbances_text(values)}

{_independent_text(values) if values["can_faults"] else _OTHER_FOOT}
"""


_OTHER_FOOT = (
    "Faults of CAN and around the process do not depend on the feet: `docs/report/faults.md` has them."
)


def _disturbances_text(values: Values) -> str:
    rows = [
        (
            f"{words}, {scene}",
            f"{1e3 * found['error_n']:.0f}",
            f"{1e3 * found['sigma_n']:.0f}",
            f"{found['within']:.1%}" + (", **missed**" if _is_missed(found) else ""),
            f"{found['usable']:.0%}",
            _camel(found["state"]),
            "-" if found["cause"] == "none" else _camel(found["cause"]),
        )
        for words, of_scenes in values["disturbances"].items()
        for scene, found in of_scenes.items()
    ]
    within = table(
        f"disturbance, scene, {SAME_TABLE} | error, rms [mN] | sigma, median [mN] | within {WANTED_SIGMAS:g} sigma | usable | state | cause",
        rows,
    )
    return f"""## Disturbances of the readings

What disturbs without breaking anything: it begins {BEGINS_S:g} s after the start, after the tare, on all six legs, and
stays to the end at {ENDS_S:g} s. One draw each. The standing feet carry {STANDING_N} times half of their largest force,
the walks have half of it as their peak. Wanted are {_WANTED_SHARE:.0%} of the errors of usable forces within
{WANTED_SIGMAS:g} sigma, or a leg that is not `Valid`. The figures are of the service with the released network, which the
same response table made that makes the readings.

{within}

Noise is measured while the robot runs, and is in sigma; above the limit of a tare it is the cause `noisy`. A shift of
readings shows in the next swing, as what the foot in the air reads beside its baseline, and is in sigma from then on.
While a foot stands, a shift along a pattern that a load has too cannot be told from that load: nine readings, and five
unknowns of a contact. Channels that a converter shifts by one look like an open last column: the leg is `Degraded`,
and its sigma does not cover the error."""


def _independent_text(values: Values) -> str:
    """Return what does not depend on the feet."""
    return _kinds_text(values["converter_kinds"]) + "\n\n" + _can_text(values["can_faults"])


def _kinds_text(kinds: Values) -> str:
    clocks = next(iter(kinds.values()))
    rows = table(
        "DONE cleared by | while converting | " + " | ".join(f"clock {clock} slow" for clock in clocks),
        [
            (
                *kind.split(" | "),
                *(
                    f"{100 * at['ok_rel']:.1f}%, {at['n_wrong']}, {at['scan_ms']:.1f}"
                    for at in by_clock.values()
                ),
            )
            for kind, by_clock in kinds.items()
        ],
    )
    return f"""## Converters as the data sheet allows them to be

What clears the DONE bit of a FDC1004 is not said, nor what a result reads as that is being converted. Each cell is
{N_SCANS} scans of six legs on one bus at {HOST_COST_US:g} us a transaction, with feet that are pressed ever harder, and
the converter of one leg hanging after scan {HANGS_AFTER} until footsense resets it: share of the readings that are OK,
how many of them are not of their conversion, time of a scan [ms]. `footsense dev benchmark` has the cost of each kind on
one bus and two.

{rows}"""


def _is_missed(found: Values) -> bool:
    return bool(found["within"] < _WANTED_SHARE) and found["state"] == State.VALID.name.lower()


def _can_text(faults: Values) -> str:
    times = ("longest_silence_s", "recovery_s", "longest_frame_delay_s", "max_age_on_arrival_s")
    rows = table(
        "fault | received | silence [ms] | recovery [ms] | delay [ms] | oldest [ms] | dropped | bus-off",
        {name: found | {time: _ms(found[time]) for time in times} for name, found in faults.items()},
        "{name} | {received_share:.1%} | "
        + " | ".join(f"{{{time}}}" for time in times)
        + " | {n_dropped_before_sending} | {n_bus_off}",
    )
    return f"""## Faults of CAN

Figures of a consumer at the other end, with the interface set up as by `deploy/80-can0.network`, and a fault from
{BREAKS_AT_S:g} s to {PASSES_AT_S:g} s. *Recovery* is the time from the end of the fault until a frame of every leg has
arrived, *oldest* the age of the oldest measurement on its arrival.

{rows}

## Faults around the process

These need a real process and real time; the tests in `tests/system/` show them: the loop or the recorder killed, a full
disk, no reader of the log, a wall clock that steps, model files replaced. None stops the forces of a running loop, and
at most the last second of a recording is lost."""


def _leg_row(fault: str, found: Values) -> tuple[str, ...]:
    shows = found["detection_s"] is not None
    return (
        fault,
        _camel(found["state"]) if shows else "-",
        "-" if found["cause"] == "none" else _camel(found["cause"]),
        _element_numbers(found["fault_mask"]) if shows else "-",
        _ms(found["detection_s"]),
        _ms(found["recovery_s"]),
        _ms(found["longest_gap_s"]),
        str(found["n_other_legs_lost_frames"]),
        "-" if found["max_error_sigmas"] is None else f"{found['max_error_sigmas']:.1f}",
        f"{1e3 * found['other_legs_max_error_n']:.0f}",
    )


def _element_numbers(mask: int) -> str:
    named = [str(element) for element in range(ELEMENTS) if mask >> element & 1]
    return "all" if len(named) == ELEMENTS else " ".join(named) or "-"


def _ms(time_s: float | None) -> str:
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"


def _camel(name: str) -> str:
    return name.title().replace("_", "")
