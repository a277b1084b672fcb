"""Open CAN as configured: on a real interface, on one of python-can, or on a scene's simulated one."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import date
from functools import partial
from pathlib import Path

from firmware_interface.can.codes import CalibrationKind
from firmware_interface.can.force import force_step_mn
from firmware_interface.can.reports import CALIBRATION_EPOCH, CalibrationFrame
from firmware_interface.can.socketcan import unpack_frame
from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.clock import MonotonicClock
from footsense.config import Config
from footsense.daemon.models import Models
from footsense.daemon.setup.expected_error import ExpectedError
from footsense.daemon.simulation import is_simulated
from footsense.errors import RecordingError
from footsense.estimation.settings import LONG_SILENCE_NS
from footsense.foot.calibration_files import FootCalibration
from footsense.ports import CanWire, Clock
from footsense.sim.can.frame_log import CanFrameLog
from footsense.sim.can.interface import SimulatedCan
from footsense.sim.faults.scene_faults import CanFault
from footsense.sim.scene import Scene
from footsense.wires.address import DEFAULT_CHANNELS
from footsense.wires.opening import POLL_PERIOD_NS, open_wire

_log = logging.getLogger(__name__)


@contextmanager
def can_sink(
    models: Models, clock: Clock, log_file: Path | None, connect: Callable[[], CanWire] | None = None
) -> Iterator[CanSink]:
    """Open the CAN output of a robot during a `with` block; at its end, send every leg's heartbeat `stopped`.

    Yields:
        The sink.

    Raises:
        CanError: The channel is missing or down.
        RecordingError: The log cannot be made, or is not whole at the end.
    """
    config, card = models.config, models.network.card
    if connect is None and config.can.interface != "socketcan":
        connect = partial(open_wire, config.can.address)
        if config.can.interface == "udp_multicast":
            _warn_of_another_service(config.can)
    with ExitStack() as stack:
        if log_file is not None:
            log = CanFrameLog(log_file, config.can.channel, connect or partial(open_wire, config.can.address))
            stack.enter_context(close_at_end(log.close))
            connect = log.connect
        sink = CanSink(
            config.can,
            config.legs,
            clock,
            cycles_per_force=config.effective_publish_every,
            force_step_mn=force_step_mn(card.max_trained_force_n),
            foot_type=card.foot_type,
            calibrations=[
                _calibration(models.calibrations_by_leg.get(leg), ExpectedError.of(unknown))
                for leg, unknown in zip(config.legs, models.uncertainties, strict=True)
            ],
            connect=connect,
        )
        stack.callback(sink.close)
        yield sink


def _calibration(found: FootCalibration | None, error: ExpectedError) -> CalibrationFrame:
    """Return the frame of a foot's calibration, with the expected error of its force."""
    kind, day = CalibrationKind.NONE, None
    if found is not None:
        kind = CalibrationKind.PRESSED
        if found.manifest.by_walking:
            kind = CalibrationKind.WALKING
        elif found.manifest.by_standing:
            kind = CalibrationKind.STANDING
        day = (date.fromisoformat(found.manifest.made[:10]) - CALIBRATION_EPOCH).days
    return CalibrationFrame(0, 0, kind, day, 100.0 * error.size_rel, error.direction_deg)


def _warn_of_another_service(can: Can) -> None:
    with closing(open_wire(can.address)) as wire:
        if another_sends(wire, MonotonicClock()):
            _log.warning(
                "another service already sends on %s: who hears both can use the forces of neither; end one, or give "
                "this one another can.channel",
                can.channel,
            )


def another_sends(wire: CanWire, clock: Clock) -> bool:
    """Listen on a channel for a moment; return whether forces arrive on it."""
    from footsense.client import LINK_IDS  # on UDP alone: a service on a robot starts without

    end_ns = clock.now_ns() + LONG_SILENCE_NS
    while (now_ns := clock.now_ns()) < end_ns:
        if any(can_id in LINK_IDS for can_id, _ in map(unpack_frame, wire.receive())):
            return True
        clock.sleep_until_ns(min(end_ns, now_ns + POLL_PERIOD_NS))
    return False


def others_hear(config: Config, scene: Scene | None) -> bool:
    """Return whether other programs receive the CAN frames of a simulation."""
    return config.can.interface != "virtual" and not can_faults(scene) and is_simulated(config)


def frames_destination(config: Config, scene: Scene | None) -> str:
    """Return in one line on which channel the CAN frames of a simulation go, and who hears them."""
    interface, channel = config.can.interface, config.can.channel
    if not others_hear(config, scene):
        return "simulated; its CAN frames stay within this process"
    if interface == "udp_multicast":
        named = "" if channel == DEFAULT_CHANNELS[interface] else f" --channel {channel}"
        return (
            f"simulated; its CAN frames go out on {channel}, to programs on this computer alone: footsense monitor "
            f"--interface udp_multicast{named}"
        )
    return f"simulated, but its CAN frames go out on {channel} of this computer, with the flag Simulated"


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
    return SimulatedCan(clock, config.can.bit_ns, faults) if faults else None
