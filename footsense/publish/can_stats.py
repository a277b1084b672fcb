"""What a CAN channel has done since it was opened; the sink counts, the metrics show."""

from dataclasses import dataclass


@dataclass(slots=True)
class CanStats:
    """Numbers of frames since the channel was opened.

    Attributes:
        sent: Handed to the channel.
        dropped: Refused by the channel, for a full queue or a dead bus, and never sent again.
        received: Arrived under a command id of ours, good or bad.
        rejected: Of those, the ones that were not obeyed: wrong crc, repeated counter, unknown command.
        bus_errors: Error frames that the controller reported.
    """

    sent: int = 0
    dropped: int = 0
    received: int = 0
    rejected: int = 0
    bus_errors: int = 0
