"""What a CAN channel has done since it was opened; the channel and the sink count, the metrics show."""

from dataclasses import dataclass


@dataclass(slots=True)
class CanStats:
    """Numbers of frames and events since the channel was first opened.

    Attributes:
        sent: Handed to the channel.
        dropped: Refused by the channel, for a full queue or a dead interface, and never sent again.
        received: Arrived under a command id of ours, good or bad.
        rejected: Of those, the ones that were not obeyed: wrong crc, repeated counter, unknown command.
        bus_errors: Error frames that the controller reported.
        bus_off: Of those, the ones that said that the controller has left the bus.
        error_passive: Of those, the ones that said that it may hardly speak any more: errors, or nobody acknowledges.
        reopened: How often the interface has been opened again after it had gone.
        unlogged: Frames that were sent and are not in the log, because whoever writes it was too slow or has ended.
    """

    sent: int = 0
    dropped: int = 0
    received: int = 0
    rejected: int = 0
    bus_errors: int = 0
    bus_off: int = 0
    error_passive: int = 0
    reopened: int = 0
    unlogged: int = 0
