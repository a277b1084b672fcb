"""Simulated SocketCAN interface and the bus behind it, frame by frame in virtual time.

A frame passes from the socket to the queue of the interface, to a mailbox of the controller, and to the wire. These
stages decide whether an old force arrives late, and vcan simulates none of them:

- A full queue refuses a frame (`pfifo`, ENOBUFS) or drops its oldest (`pfifo_head_drop`, no error).
- A frame without an acknowledgement is repeated for ever, and the others wait behind it; in one-shot mode it is sent
  once and lost, as is a frame that loses an arbitration.
- Bus-off: the driver takes the carrier away. The kernel then empties the queue, but at most once a second: in a
  bus-off that follows soon, frames stay in the queue and go out after the restart. The restart empties the
  mailboxes. While the queue is deactivated, a frame is taken without error and lost.
- Down: queue and mailboxes are emptied, and each socket gets ENETDOWN. A socket of an interface that is gone
  never works again.

Source:
    Linux: net/can/af_can.c, net/can/raw.c, drivers/net/can/dev/dev.c.
"""

import errno
import math
import os
from collections import deque
from collections.abc import Sequence

from firmware_interface.can.socketcan import pack_frame
from footsense.errors import CanError
from footsense.ports import CanWire, Clock
from footsense.sim.can.controller import CanController, CanSettings
from footsense.sim.can.transmit_queue import OtherSender, QueuedFrame, TransmitQueue
from footsense.sim.faults.scene_faults import (
    CanBusOff,
    CanDown,
    CanFault,
    CanNoAck,
    CanQueueFull,
    CanTraffic,
    Schedule,
)

#: Settings of `deploy/80-can0.network` with `deploy/80-can0-one-shot.conf`.
AS_DEPLOYED = CanSettings(queue_frames=16, head_drop=True, one_shot=True, restart_ns=100_000_000)

#: Unread frames of a socket; the kernel drops further ones.
_MAX_UNREAD_FRAMES = 300


class SimulatedCan:
    """Simulated SocketCAN interface and the CAN bus behind it.

    Args:
        clock: The clock; events on the bus are processed whenever a socket is used.
        bit_ns: Duration of a bit on the bus [ns].
        faults: Faults of the bus and of the interface.
        settings: Settings of the interface.

    Attributes:
        queue: Transmit queue.
        controller: Controller; its `on_delivered` observes the frames that arrive.
        present: Whether the interface exists.
        up: Whether it is up.
    """

    def __init__(
        self,
        clock: Clock,
        bit_ns: float,
        faults: Sequence[CanFault] = (),
        settings: CanSettings = AS_DEPLOYED,
    ) -> None:
        self._clock = clock
        self._faults = Schedule((fault.span_ns, fault) for fault in faults)
        self._faults.at(-1.0)
        self._senders = [
            OtherSender(fault) for fault in faults if isinstance(fault, CanTraffic | CanQueueFull)
        ]
        self._sockets: list[_Socket] = []
        self._t_ns = 0
        self.up = self.present = True
        self.queue = TransmitQueue(settings.queue_frames, head_drop=settings.head_drop)
        nodes = [sender for sender in self._senders if sender.is_node]
        self.controller = CanController(self.queue, settings, bit_ns, nodes, self.deliver_to_sockets)

    def connect(self) -> CanWire:
        """Return a new socket that is bound to the interface.

        Raises:
            CanError: The interface does not exist at the moment.
        """
        self.process_events_until_now()
        if not self.present:
            raise CanError("the simulated CAN interface does not exist at the moment")
        socket = _Socket(self, self._sockets)
        self._sockets.append(socket)
        if not self.up:
            socket.error = errno.ENETDOWN
        return socket

    def enqueue_socket_frame(self, frame: bytes) -> bool:
        """Append a frame to the transmit queue; return whether it was accepted.

        Returns:
            False if it was refused.
        """
        taken = self.queue.put(QueuedFrame(self._t_ns, frame, from_socket=True))
        self.controller.start_transmission(self._t_ns)
        return taken

    def process_events_until_now(self) -> None:
        """Process all CAN events up to the present time."""
        now_ns = self._clock.now_ns()
        while (t_ns := self._due_ns()) <= now_ns:
            self._t_ns = max(self._t_ns, math.ceil(t_ns))
            self._process_due(self._t_ns)
        self._t_ns = max(self._t_ns, now_ns)

    def _due_ns(self) -> float:
        """Return the time of the next CAN event [ns]; infinite if none is pending."""
        others_ns = (sender.due_ns for sender in self._senders)
        return min(self._faults.until_ns, self.controller.due_ns, self.queue.carrier_check_ns, *others_ns)

    def _process_due(self, t_ns: int) -> None:
        """Process the CAN events that are due at `t_ns` [ns]."""
        if self._faults.until_ns <= t_ns:
            self._switch_faults(t_ns)
        self.controller.process_due(t_ns)
        if self.queue.carrier_check_ns <= t_ns:
            self.queue.run_carrier_check(t_ns)
        for sender in self._senders:
            if sender.due_ns <= t_ns:
                sender.mark_frame_waiting()
                if not sender.is_node and self.up:
                    self.queue.put(QueuedFrame(t_ns, pack_frame(sender.can_id, bytes(8)), from_socket=False))
        self.controller.start_transmission(t_ns)

    def _switch_faults(self, t_ns: int) -> None:
        """Start and end the faults whose time is `t_ns` [ns]."""
        acting = self._faults.at(t_ns)
        down = [fault for fault in acting if isinstance(fault, CanDown)]
        if self.up and down:
            self.queue.reset()
            self.controller.reset()
            for socket in self._sockets:
                socket.error = errno.ENETDOWN
        self.up = self.controller.running = not down
        self.present = not any(fault.unplugged for fault in down)
        if not self.present:
            for socket in self._sockets:
                socket.gone = True
        self.controller.no_ack = any(isinstance(fault, CanNoAck) for fault in acting)
        self.controller.shorted = any(isinstance(fault, CanBusOff) for fault in acting)

    def deliver_to_sockets(self, frame: bytes) -> None:
        """Append a frame of another node, or an error frame of the controller, to what every socket receives."""
        for socket in self._sockets:
            socket.unread.append(frame)


class _Socket:
    """Simulated raw CAN socket that is bound to the interface (a `CanWire`)."""

    def __init__(self, can: SimulatedCan, sockets: "list[_Socket]") -> None:
        self._can = can
        self._sockets = sockets
        self.unread: deque[bytes] = deque(maxlen=_MAX_UNREAD_FRAMES)
        self.error = 0  # reported once, as by the kernel
        self.gone = False

    def send(self, frames: Sequence[bytes], t_ns: int = 0) -> int:
        """Queue frames up to the first that the interface refuses; return the number accepted.

        Returns:
            How many were taken.

        Raises:
            OSError: The interface is down or gone.
        """
        del t_ns
        self._can.process_events_until_now()
        if self.gone or not self._can.up:
            code = errno.ENXIO if self.gone else errno.ENETDOWN
            raise OSError(code, os.strerror(code))
        for n, frame in enumerate(frames):
            if not self._can.enqueue_socket_frame(frame):
                return n
        return len(frames)

    def receive(self) -> list[bytes]:
        """Return the frames that have arrived, oldest first.

        Raises:
            OSError: The interface has gone down.
        """
        self._can.process_events_until_now()
        if self.error:
            code, self.error = self.error, 0
            raise OSError(code, os.strerror(code))
        arrived = list(self.unread)
        self.unread.clear()
        return arrived

    def close(self) -> None:
        """Close the socket; frames that it has queued are still sent."""
        if self in self._sockets:
            self._sockets.remove(self)
