"""Tare commands from the page, sent over CAN as a gait controller would; require the token printed at start."""

import hmac
import secrets
from contextlib import suppress

from firmware_interface.can.codes import NODE_IDS, CommandKind
from firmware_interface.can.socketcan import pack_frame
from footsense.can.python_can import open_wire
from footsense.client import PendingCommands
from footsense.config import Config
from footsense.errors import ConfigError
from footsense.ports import CanWire, Clock

#: Counters of commands before they repeat.
_N_COUNTER_VALUES = 15
_NS_PER_S = 1_000_000_000


class TareCommandSender:
    """Sends tare commands to the service over CAN.

    Args:
        wire: The CAN channel of the service.
        clock: The machine's clock.

    Attributes:
        token: The token that a page has to show.
    """

    def __init__(self, wire: CanWire, clock: Clock) -> None:
        self._wire = wire
        self._clock = clock
        # Another counter than that of a viewer that has just ended.
        self._commands = PendingCommands(clock.now_ns() // _NS_PER_S % _N_COUNTER_VALUES)
        self.token = secrets.token_urlsafe(12)

    def send_tare(self, leg: str, token: str) -> str:
        """Send a tare command; return the answer as text (the tare's result arrives later as an event)."""
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            return "no tare: the token is not the one that was printed at start"
        if leg not in NODE_IDS:
            return f"no tare: {leg[:20]!r} is no leg"
        now_ns = self._clock.now_ns()
        frame = pack_frame(*self._commands.encode(NODE_IDS[leg], CommandKind.TARE, now_ns))
        n_sent = 0
        with suppress(OSError):
            n_sent = self._wire.send(frame, now_ns)
        return "" if n_sent else "no tare: CAN takes no frame; is the interface up?"

    def close(self) -> None:
        """Close the CAN interface."""
        self._wire.close()


def open_tare_command_sender(config: Config, clock: Clock) -> TareCommandSender:
    """Open the CAN interface of a robot for tare commands.

    Raises:
        ConfigError: The robot executes no commands, or has no channel that another process can reach.
        CanError: The channel is missing or down.
    """
    can = config.can
    if can.interface == "virtual":
        raise ConfigError(
            "--allow-commands: can.interface virtual stays within the service, no command gets in"
        )
    if not can.executes_commands:
        raise ConfigError("--allow-commands: the service executes none, can.commands is false")
    return TareCommandSender(open_wire(can.interface, can.channel, can.bitrate, []), clock)
