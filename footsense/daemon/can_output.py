"""Open the CAN output as configured, on a real interface or on a scene's simulated one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from footsense.can.sink import CanSink
from footsense.config import Config
from footsense.errors import RecordingError
from footsense.ports import CanWire, Clock
from footsense.sim.can.interface import SimulatedCan
from footsense.sim.faults.scene_faults import CanFault
from footsense.sim.scene import Scene


@contextmanager
def can_sink(
    config: Config,
    clock: Clock,
    log_file: Path | None,
    *,
    force_step_mn: int = 1,
    connect: Callable[[], CanWire] | None = None,
) -> Iterator[CanSink]:
    """Open the CAN output during a `with` block; at its end, send every leg's heartbeat `stopped`.

    Yields:
        The sink.

    Raises:
        CanError: The channel is missing or down.
        RecordingError: The log cannot be made, or is not whole at the end.
    """
    sink = CanSink(
        config.can,
        config.legs,
        clock,
        publish_every=config.effective_publish_every,
        force_step_mn=force_step_mn,
        log_file=log_file,
        connect=connect,
    )
    with close_at_end(sink.close):
        yield sink


@contextmanager
def close_at_end(close: Callable[[], None]) -> Iterator[None]:
    """Call `close` at the end of a `with` block; its error must not hide one that ended the block."""
    try:
        yield
    except BaseException:
        with suppress(RecordingError):
            close()
        raise
    close()


def can_faults(scene: Scene | None) -> list[CanFault]:
    """Return the CAN faults of a scene; with any, the CAN interface is simulated."""
    return [fault for fault in scene.faults if isinstance(fault, CanFault)] if scene is not None else []


def simulated_can(config: Config, scene: Scene | None, clock: Clock) -> SimulatedCan | None:
    """Return the simulated CAN interface if the scene has CAN faults, else None."""
    faults = can_faults(scene)
    return SimulatedCan(clock, config.can.bitrate, faults) if faults else None
