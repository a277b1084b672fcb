"""A SocketCAN interface and the bus behind it, frame by frame in virtual time.

A frame goes from the socket into the interface's queue, from there into one of the controller's mailboxes, and
from there onto the wire, where it may find nobody who acknowledges, or no wire. What becomes of it on the way
decides whether an old force comes late, and vcan shows none of it:

- A full queue refuses a frame (`pfifo`, ENOBUFS) or drops its oldest (`pfifo_head_drop`, no error).
- A frame without an acknowledgement is sent again for ever, and the rest waits behind it; in one-shot mode it is
  sent once, and gone. So is one that loses an arbitration.
- Bus-off: the driver takes the carrier away. The kernel then empties the queue, but at most once a second: in a
  bus-off that follows soon, frames stay in the queue and go out after the restart. The restart empties the
  mailboxes. While the queue is deactivated, a frame is taken without error and lost.
- Down: queue and mailboxes are emptied, and each socket is told ENETDOWN. A socket of an interface that is gone
  never works again.

Not modelled: real stuff bits, every frame is as long as it can be; faults that begin or end within a frame, which
count from the next on; receive errors; drivers that keep the carrier in bus-off.

Source:
    Linux: net/can/af_can.c, net/can/raw.c, drivers/net/can/dev. ISO 11898-1: error counters, retransmission.
"""

import errno
import math
import os
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from firmware_interface.socketcan import (
    CONTROLLER_ACTIVE,
    FRAME_BYTES,
    ErrorClass,
    error_frame,
    pack_frame,
    split_frames,
)
from footsense.errors import CanError
from footsense.ports import CanWire, Clock
from footsense.sim.can_faults import CanBusOff, CanDown, CanFault, CanNoAck, CanQueueFull, CanTraffic
from footsense.sim.can_queue import Queued, TransmitQueue

__all__ = ["AS_DEPLOYED", "CanSettings", "SimulatedCan", "frame_bits"]

_NS_PER_S = 1_000_000_000

#: Bits of an error flag, its delimiter and the pause behind it; more for a controller that is error passive.
_ERROR_BITS = 6 + 8 + 3
_SUSPEND_BITS = 8
#: Bits of a frame behind the one in which an acknowledgement is missing: delimiter, end of frame, pause.
_AFTER_ACK_BITS = 1 + 7 + 3
#: Bits of silence after which a controller may come back to the bus.
_RECOVERY_BITS = 128 * 11

_PASSIVE = 128
_BUS_OFF = 256
_TX_PASSIVE = 0x20

#: Frames that a socket keeps unread; the kernel drops what comes on top.
_MOST_UNREAD = 300


class CanSettings(NamedTuple):
    """How the interface is set up.

    Attributes:
        queue_frames: Room in its queue.
        head_drop: Whether a full queue drops its oldest frame instead of refusing the newest.
        one_shot: Whether the controller tries each frame once.
        restart_ns: Time from bus-off to the restart [ns]; 0 for none.
        mailboxes: Frames that the controller holds.
    """

    queue_frames: int
    head_drop: bool
    one_shot: bool
    restart_ns: int
    mailboxes: int = 3


#: What `deploy/80-can0.network` sets.
AS_DEPLOYED = CanSettings(queue_frames=16, head_drop=True, one_shot=True, restart_ns=100_000_000)


def frame_bits(n_data: int) -> int:
    """Return the longest that a frame with an 11-bit id can be, the pause behind it included [bits].

    Example:
        >>> frame_bits(8)
        135
    """
    return 8 * n_data + 47 + (34 + 8 * n_data - 1) // 4


class _Sender:
    """Whoever else sends: a node on the bus, or a program on the same computer."""

    def __init__(self, fault: CanTraffic | CanQueueFull) -> None:
        self.period_ns = _NS_PER_S / fault.rate_hz
        self.due_ns: float = fault.at_ns
        self.until_ns = fault.until_ns
        self.on_bus = isinstance(fault, CanTraffic)
        self.can_id = fault.can_id if isinstance(fault, CanTraffic) else 0x7FF
        self.waiting = False  # a node holds one frame, its newest


class SimulatedCan:
    """An interface and its bus.

    Args:
        clock: The time; what happens on the bus is worked out whenever a socket asks.
        bitrate: Bit rate of the bus [bit/s].
        faults: What goes wrong, and when.
        settings: How the interface is set up.

    Attributes:
        hear: Called with each frame of ours that reached the other nodes: when, when it was handed over [ns], and
            the frame. None for nobody.
        n_delivered: Frames of ours that reached them.
        n_lost: Frames of ours that were tried once and not again.
        n_flushed: Frames of ours that the controller held when it was restarted or stopped.
        n_bus_off: How often the controller has gone bus-off.
        queue: The interface's queue.
    """

    def __init__(
        self,
        clock: Clock,
        bitrate: int,
        faults: Sequence[CanFault] = (),
        settings: CanSettings = AS_DEPLOYED,
    ) -> None:
        self._clock = clock
        self._bit_ns = _NS_PER_S / bitrate
        self._settings = settings
        self._faults = tuple(faults)
        self._senders = [_Sender(fault) for fault in faults if isinstance(fault, CanTraffic | CanQueueFull)]
        edges = {fault.at_ns for fault in faults} | {fault.until_ns for fault in faults}
        self._edges = deque(sorted(edge for edge in edges if edge < math.inf))
        self._sockets: list[_Socket] = []
        self._mailboxes: deque[Queued] = deque()
        self._free_ns: float = 0  # when what is on the wire has passed
        self._passing: Callable[[], None] | None = None  # what is due then
        self._error_count = 0
        self._restart_ns = math.inf
        self._t_ns = 0
        self._no_ack = self._shorted = False
        self.up = self.present = True
        self.queue = TransmitQueue(settings.queue_frames, head_drop=settings.head_drop)
        self.hear: Callable[[int, int, bytes], object] | None = None
        self.n_delivered = self.n_lost = self.n_flushed = self.n_bus_off = 0

    def connect(self) -> CanWire:
        """Return a socket that is bound to the interface.

        Raises:
            CanError: There is no such interface at the moment.
        """
        self.advance()
        if not self.present:
            raise CanError("the simulated CAN interface does not exist at the moment")
        socket = _Socket(self, self._sockets)
        self._sockets.append(socket)
        if not self.up:
            socket.error = errno.ENETDOWN
        return socket

    def arrive(self, can_id: int, data: bytes) -> None:
        """Let every socket receive a frame of another node."""
        self.advance()
        self._tell(pack_frame(can_id, data))

    def take(self, frame: bytes) -> bool:
        """Take a frame into the queue.

        Returns:
            False if it was refused.
        """
        taken = self.queue.put(Queued(self._t_ns, frame, ours=True))
        self._pump()
        return taken

    def advance(self) -> None:
        """Let everything happen that happens up to now."""
        now_ns = self._clock.now_ns()
        while True:
            t_ns = min(
                self._edges[0] if self._edges else math.inf,
                self._free_ns if self._passing else math.inf,
                self._restart_ns,
                self.queue.look_ns,
                *(sender.due_ns for sender in self._senders),
            )
            if t_ns > now_ns:
                break
            self._t_ns = max(self._t_ns, round(t_ns))
            self._happen(t_ns)
            self._pump()
        self._t_ns = max(self._t_ns, now_ns)

    def _happen(self, t_ns: float) -> None:
        """Do what is due at `t_ns`."""
        while self._edges and self._edges[0] <= t_ns:
            self._edges.popleft()
            self._turn()
        if self._passing and self._free_ns <= t_ns:
            passed, self._passing = self._passing, None
            passed()
        if self._restart_ns <= t_ns:
            self._restart()
        if self.queue.look_ns <= t_ns:
            self.queue.look(self._t_ns)
        for sender in self._senders:
            if sender.due_ns <= t_ns:
                self._other_sends(sender)

    def _turn(self) -> None:
        """Begin and end the faults of this moment."""
        acting = [fault for fault in self._faults if fault.at_ns <= self._t_ns < fault.until_ns]
        self._no_ack = any(isinstance(fault, CanNoAck) for fault in acting)
        self._shorted = any(isinstance(fault, CanBusOff) for fault in acting)
        down = [fault for fault in acting if isinstance(fault, CanDown)]
        self.present = not any(fault.unplugged for fault in down)
        if self.up and down:
            self._stop()
        self.up = not down
        for socket in self._sockets if not self.present else ():
            socket.gone = True

    def _stop(self) -> None:
        """Bring the interface down, as the kernel does."""
        self.queue.purge()
        self.queue.regain_carrier()
        self.queue.look_ns = math.inf
        self._flush()
        self._passing = None
        self._error_count = 0
        self._restart_ns = math.inf
        for socket in self._sockets:
            socket.error = errno.ENETDOWN

    def _flush(self) -> None:
        self.n_flushed += sum(frame.ours for frame in self._mailboxes)
        self._mailboxes.clear()

    def _restart(self) -> None:
        """Restart the controller after bus-off."""
        self._restart_ns = math.inf
        self._flush()
        self._error_count = 0
        self.queue.regain_carrier()
        self._tell(error_frame(ErrorClass.RESTARTED))
        self._occupy(_RECOVERY_BITS, lambda: None)

    def _other_sends(self, sender: _Sender) -> None:
        """Let a node or another program send its next frame."""
        sender.due_ns += sender.period_ns
        if sender.due_ns >= sender.until_ns:
            sender.due_ns = math.inf
        if sender.on_bus:
            sender.waiting = True
        elif self.up:
            self.queue.put(Queued(self._t_ns, pack_frame(sender.can_id, bytes(8)), ours=False))

    def _pump(self) -> None:
        """Fill the mailboxes from the queue, and begin a frame if the wire is free."""
        while self.up and len(self.queue) and len(self._mailboxes) < self._settings.mailboxes:
            self._mailboxes.append(self.queue.take())
        if self._passing is None:
            self._begin()

    def _begin(self) -> None:
        """Arbitrate, and put the winner onto the wire."""
        ours = self._mailboxes[0] if self._mailboxes and self._error_count < _BUS_OFF and self.up else None
        # Without an acknowledgement, and on a shorted bus, no other node is there to be heard.
        reachable = not (self._no_ack or self._shorted)
        others = [sender for sender in self._senders if sender.waiting] if reachable else []
        other = min(others, key=lambda sender: sender.can_id, default=None)
        our_id, data = next(split_frames(ours.data)) if ours else (0, b"")
        if other and not (ours and our_id < other.can_id):
            other.waiting = False
            if ours and self._settings.one_shot:  # the arbitration was lost
                self._give_up()
            self._occupy(frame_bits(8), lambda: None)
        elif ours and self._shorted:
            self._occupy(1 + _ERROR_BITS + self._suspend(), self._fail)
        elif ours and self._no_ack:
            bits = frame_bits(len(data)) - _AFTER_ACK_BITS + _ERROR_BITS + self._suspend()
            self._occupy(bits, self._miss_ack)
        elif ours:
            self._occupy(frame_bits(len(data)), self._deliver)

    def _occupy(self, bits: int, then: Callable[[], None]) -> None:
        self._free_ns = self._t_ns + bits * self._bit_ns
        self._passing = then

    def _suspend(self) -> int:
        """Return the bits that an error passive controller waits in addition."""
        return _SUSPEND_BITS if self._error_count >= _PASSIVE else 0

    def _give_up(self) -> None:
        self.n_lost += self._mailboxes.popleft().ours

    def _deliver(self) -> None:
        frame = self._mailboxes.popleft()
        self._count_errors(-1)
        if frame.ours:
            self.n_delivered += 1
            if self.hear is not None:
                self.hear(self._t_ns, frame.handed_ns, frame.data)

    def _miss_ack(self) -> None:
        """Nobody acknowledged; that alone takes no controller beyond error passive."""
        if self._error_count < _PASSIVE:
            self._count_errors(8)
        if self._settings.one_shot:
            self._give_up()

    def _fail(self) -> None:
        """The first bit came back wrong."""
        self._count_errors(8)
        if self._error_count >= _BUS_OFF:
            self.n_bus_off += 1
            self.queue.lose_carrier(self._t_ns)
            if self._settings.restart_ns:
                self._restart_ns = self._t_ns + self._settings.restart_ns
        elif self._settings.one_shot:
            self._give_up()

    def _count_errors(self, change: int) -> None:
        """Move the transmit error counter, and tell the sockets when that changes the controller's state."""
        before, after = self._error_count, max(0, self._error_count + change)
        self._error_count = after
        if after >= _BUS_OFF:
            self._tell(error_frame(ErrorClass.BUS_OFF))
        elif before < _PASSIVE <= after:
            self._tell(error_frame(ErrorClass.CONTROLLER, _TX_PASSIVE))
        elif after < _PASSIVE <= before:
            self._tell(error_frame(ErrorClass.CONTROLLER, CONTROLLER_ACTIVE))

    def _tell(self, frame: bytes) -> None:
        for socket in self._sockets:
            socket.unread.append(frame)


class _Socket:
    """A socket that is bound to the interface: what stands behind `CanWire`."""

    def __init__(self, can: SimulatedCan, sockets: "list[_Socket]") -> None:
        self._can = can
        self._sockets = sockets
        self.unread: deque[bytes] = deque(maxlen=_MOST_UNREAD)
        self.error = 0  # told once, as the kernel does
        self.gone = False

    def send(self, frames: bytes, t_ns: int = 0) -> int:
        """Hand over frames up to the first that is refused.

        Returns:
            How many were taken.

        Raises:
            OSError: The interface is down or gone.
        """
        del t_ns
        self._can.advance()
        self._check()
        for start in range(0, len(frames), FRAME_BYTES):
            if not self._can.take(frames[start : start + FRAME_BYTES]):
                return start // FRAME_BYTES
        return len(frames) // FRAME_BYTES

    def receive(self) -> list[bytes]:
        """Return what has arrived.

        Raises:
            OSError: The interface has gone down.
        """
        self._can.advance()
        if self.error:
            code, self.error = self.error, 0
            raise OSError(code, os.strerror(code))
        arrived = list(self.unread)
        self.unread.clear()
        return arrived

    def close(self) -> None:
        """Release the socket; what it has handed over stays in the queue."""
        if self in self._sockets:
            self._sockets.remove(self)

    def _check(self) -> None:
        code = errno.ENXIO if self.gone else 0 if self._can.up else errno.ENETDOWN
        if code:
            raise OSError(code, os.strerror(code))
