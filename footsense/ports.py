"""Interfaces (ports) between the daemon and its hardware, network, clock and observers.

A port has an implementation for hardware and one for the simulation, chosen once in `footsense.daemon`; code above a
port cannot distinguish them.
"""

from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:  # the client has clocks and wires without numpy
    from footsense.frames import CapFrame, Cycle, Mask, ReferenceSamples, SensorStatistics, Vector

#: Bounds of the wake-up latency histogram [s]: FIFO wakes within 0.2 ms, a busy machine without it within some 10 ms.
WAKEUP_LATENCY_BUCKET_BOUNDS_S = (
    *(5e-6, 1e-5, 2e-5, 3e-5, 5e-5, 7e-5, 1e-4, 1.5e-4, 2e-4, 3e-4, 5e-4),
    *(1e-3, 2e-3, 5e-3, 1e-2, 5e-2),
)


class Transaction(NamedTuple):
    """One I2C transaction to one address: a write, a read, or a write and then a read.

    Attributes:
        address: 7-bit address.
        write: Bytes to write; none for a plain read. Without bytes to read either, the transaction only tests whether
            the address is acknowledged, which not every adapter supports.
        n_read: Bytes to read, after a repeated start if something was written; 0 for none.
    """

    address: int
    write: bytes
    n_read: int = 0


class I2cBus(Protocol):
    """Interface of an I2C adapter."""

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one I2C transaction from START to STOP; return the bytes read (empty for a plain write).

        Raises:
            NackError: No device acknowledged the address or a byte.
            I2cTimeoutError: The adapter gave up waiting for a line.
            I2cError: Anything else that made the transaction void.
        """
        ...


class MuxResetLine(Protocol):
    """Interface of the GPIO that drives a mux's RESET pin."""

    def pulse(self) -> None:
        """Pull the RESET pin low for a moment, which disconnects all mux channels."""
        ...


class Clock(Protocol):
    """Interface of the monotonic clock."""

    def now_ns(self) -> int:
        """Return the monotonic time since an arbitrary start [ns]."""
        ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until `t_ns` [ns]; return at once if that has passed."""
        ...


class WakeupLatency:
    """Histogram of the wake-up latency of one thread, recorded by its clock.

    Attributes:
        histogram: Wake-ups in each bucket of `WAKEUP_LATENCY_BUCKET_BOUNDS_S`, those above the last
            bound, and the sum of their latencies [s].
        overruns: Deadlines that had passed before the thread could sleep.
    """

    def __init__(self) -> None:
        self.histogram = array("d", [0.0]) * (len(WAKEUP_LATENCY_BUCKET_BOUNDS_S) + 2)
        self.overruns = 0


class SerialPort(Protocol):
    """Interface of a serial port to a microcontroller or sensor, which may be unplugged and reappear.

    Attributes:
        n_opened: Number of times that it was opened; when it changes, a reader drops an incomplete message.
    """

    n_opened: int

    def read(self) -> bytes:
        """Return the bytes received so far, possibly none, without waiting; reopen a port that has disappeared."""
        ...

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Wait until bytes have arrived, or until `t_ns` [ns]."""
        ...

    def write(self, data: bytes) -> None:
        """Send a few bytes; they are lost if the port has disappeared."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


class CanWire(Protocol):
    """Interface of an open CAN socket; frames as in `firmware_interface.can.socketcan`."""

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        """Queue frames for sending without waiting, as many as fit; return their number.

        Args:
            frames: The frames.
            t_ns: Time of sending [ns]; only a virtual channel uses it.

        Returns:
            Number of frames queued, from the first on.

        Raises:
            OSError: The interface is down or gone, and so is every frame that it had not sent yet.
        """
        ...

    def receive(self) -> list[bytes]:
        """Return the received frames, oldest first, error frames included, without waiting.

        Raises:
            OSError: The interface is down or gone.
        """
        ...

    def close(self) -> None:
        """Close the CAN socket."""
        ...


class FrameSource(Protocol):
    """Interface of a source of capacitance frames: scanner, microcontroller or recording."""

    def read(self) -> "CapFrame | None":
        """Wait for the next capacitance frame and return it; None at the end of a recording."""
        ...

    def close(self) -> None:
        """End the threads, mux channels and ports that the source itself opened; I2C buses are closed by the caller."""
        ...


class ReferenceSensor(Protocol):
    """Interface of the reference force sensor of a test stand.

    Attributes:
        statistics: Counts so far.
    """

    statistics: "SensorStatistics"

    def read(self, now_ns: int) -> "ReferenceSamples":
        """Return the force samples since the last call, oldest first, possibly none, without waiting.

        Args:
            now_ns: Current time [ns], to which the samples' own times are mapped.

        Raises:
            ReferenceSensorError: The bytes are no records of this sensor.
        """
        ...

    def close(self) -> None:
        """Close the sensor's port."""
        ...


class Window(NamedTuple):
    """Network input: the last three readings of every element of some feet, newest first.

    Attributes:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, 3, 9).
        age_s: Time from the middle of each conversion to the time that the load is asked for [s], same shape.
        missing: The imputed elements, shape (rows, elements).
    """

    closure_rel: "Vector"
    age_s: "Vector"
    missing: "Mask"


class LoadEstimate(NamedTuple):
    """Network output: estimated force and contact of some feet, with standard deviations.

    Attributes:
        force_n: Ground reaction on the foot [N], foot frame, shape (rows, 3).
        sigma_n: Standard deviation of each component [N], same shape.
        contact_point_and_friction: Contact point on the ball, stereographic (normal_x, normal_y) / (1 + normal_z), and
            tangential over normal force, both forward and to the left [1], shape (rows, 4).
        contact_sigma: Standard deviation of each [1], same shape.
    """

    force_n: "Vector"
    sigma_n: "Vector"
    contact_point_and_friction: "Vector"
    contact_sigma: "Vector"


class LoadEstimator(Protocol):
    """Interface of the network that estimates the loads of feet from their last readings."""

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated load of every foot (row) of the window."""
        ...


class Observer(Protocol):
    """Interface of an observer of every cycle (recorder, metrics, live table); it must not change the cycle."""

    def observe(self, cycle: "Cycle") -> None:
        """Process one cycle without blocking."""
        ...

    def close(self) -> None:
        """Finish outputs and close files at the end of the run; does nothing by default."""
        return
