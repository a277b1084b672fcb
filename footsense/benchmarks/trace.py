"""Count the modules, functions and calls of one conversion, as `footsense dev trace` prints them.

A simulated robot walks, with the CAN sink and the observers of `footsense run --record`: journal, supervision, metrics,
recorder, run statistics. While the loop runs, the interpreter's profiler hook counts every Python call of `footsense`
and `firmware_interface`, clock and loop included; a comprehension or a resumed generator is a call, as it is to the
interpreter. Left out: the simulator with its clock (`footsense/sim`), the command line, C functions, and libraries.
What the simulator calls is left out as well. CAN is an interface of python-can here, which is the simulation's
(`footsense/wires/python_can.py`): on a robot `footsense/wires/socket_wire.py` stands in its place, with one
`send` for the frames of a cycle and one `receive` a cycle.

A conversion of six legs is one turn of the loop; every fourth sends two frames on CAN per leg. Counted are the
conversions after the tare. A function counts with more than one call in two conversions; what runs less often (the
frames on CAN, a step of drift tracking) is in the total of calls, and marked in the list.
"""

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType, FrameType

import footsense
from footsense.config import DEFAULT, Config
from footsense.daemon.service import open_service
from footsense.sim.scene import load_scene
from footsense.telemetry.run_statistics import RunStatistics

#: Conversions before anything is counted: half a second of walk, which includes the tare.
_WARM_UP_CONVERSIONS = 200
_COUNTED_CONVERSIONS = 2000
#: Calls per conversion above which a function counts as steady.
_MIN_STEADY_CALLS = 0.5

_SOURCE_ROOT = Path(footsense.__file__).parent.parent
_SIMULATOR = f"{_SOURCE_ROOT.as_posix()}/footsense/sim/"
# `wires/python_can.py` is the CAN of a simulated robot; a robot's own goes through `wires/socket_wire.py`.
_EXCLUDED_PATHS = (
    "footsense/sim/",
    "footsense/cli/",
    "footsense/benchmarks/",
    "footsense/wires/python_can.py",
)

Calls = dict[tuple[str, str], float]


def calls_per_conversion(n: int = _COUNTED_CONVERSIONS, config: Config = DEFAULT) -> Calls:
    """Return the mean number of calls per conversion of each function of the service, in a simulated walk.

    Args:
        n: Conversions to count.
        config: The robot.

    Returns:
        Calls per conversion by module and qualified name.
    """
    calls: Counter[CodeType] = Counter()

    def count(frame: FrameType, event: str, _argument: object) -> None:
        if event == "call" and not _is_simulated(frame):
            calls[frame.f_code] += 1

    scene = load_scene("measured_walk")
    with (
        TemporaryDirectory() as folder,
        open_service(config, scene, real_time=False, record=Path(folder) / "walk.mcap") as service,
    ):
        service.observers.append(RunStatistics(service.legs, service.true_force_n_at))
        service.run(_stop_after_iterations(_WARM_UP_CONVERSIONS))
        sys.setprofile(count)
        try:
            service.run(_stop_after_iterations(n))
        finally:
            sys.setprofile(None)
    return _mean_calls_by_function(calls, n)


def _is_simulated(frame: FrameType | None) -> bool:
    """Return whether a stack frame or any of its callers is simulator code."""
    while frame is not None and not frame.f_code.co_filename.startswith(_SIMULATOR):
        frame = frame.f_back
    return frame is not None


def _mean_calls_by_function(calls: Counter[CodeType], n_conversions: int) -> Calls:
    """Return the mean calls per conversion by (module, function)."""
    calls_by_function: Counter[tuple[str, str]] = Counter()
    for code, n in calls.items():
        path = Path(code.co_filename)
        module = path.relative_to(_SOURCE_ROOT).as_posix() if path.is_relative_to(_SOURCE_ROOT) else ""
        if module.startswith(("footsense/", "firmware_interface/")) and not module.startswith(
            _EXCLUDED_PATHS
        ):
            calls_by_function[module, code.co_qualname] += n
    return {function: n / n_conversions for function, n in calls_by_function.items()}


def functions_called_steadily(calls: Calls) -> list[tuple[str, str]]:
    """Return (module, qualified name) of every function called in at least every second conversion."""
    return [function for function, n in calls.items() if n > _MIN_STEADY_CALLS]


def _stop_after_iterations(n: int) -> Callable[[], bool]:
    """Return a stop condition that becomes true after `n` iterations of the main loop."""
    turns = iter(range(n))
    return lambda: next(turns, None) is None
