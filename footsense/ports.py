"""The ports of the daemon, one to four methods each.

A port has an implementation for hardware and one for the simulation, chosen once in `footsense.daemon`; code above a
port cannot tell which.
"""

from array import array
from typing import NamedTuple, Protocol

from footsense.frames import CapFrame, Command, CommandResult, ContactFrame, Cycle, Mask, Reference, Vector

#: Bounds of the wake-up latency histogram [s]: FIFO wakes within 0.2 ms, a busy machine without it within some 10 ms.
LATENCY_BOUNDS_S = (
    *(5e-6, 1e-5, 2e-5, 3e-5, 5e-5, 7e-5, 1e-4, 1.5e-4, 2e-4, 3e-4, 5e-4),
    *(1e-3, 2e-3, 5e-3, 1e-2, 5e-2),
)


class Transaction(NamedTuple):
    """One I2C transaction that every Linux adapter can do: a write, a read, or one and then the other, to one address.

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
    """Port of one I2C adapter."""

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction, from START to STOP, and return the bytes read (empty for a plain write).

        Raises:
            NackError: No device acknowledged the address or a byte.
            BusTimeoutError: The adapter gave up waiting for a line.
            BusError: Anything else that made the transaction void.
        """
        ...


class ResetLine(Protocol):
    """The RESET pin of a mux, driven by the host."""

    def pulse(self) -> None:
        """Pull the pin low for a moment, which disconnects every channel."""
        ...


class Clock(Protocol):
    """Monotonic time; the only time in the program."""

    def now_ns(self) -> int:
        """Return the time since an arbitrary start [ns]."""
        ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return at `t_ns`, or at once if that has passed."""
        ...


class WakeupLatency:
    """Wake-up latency of one thread, measured by its clock.

    Attributes:
        bounds_s: Bounds of the histogram [s].
        histogram: Wake-ups in each bucket, those above the last bound, and the sum of their latencies [s].
        overruns: Deadlines that had passed before the thread could sleep.
    """

    bounds_s = LATENCY_BOUNDS_S

    def __init__(self) -> None:
        self.histogram = array("d", [0.0]) * (len(LATENCY_BOUNDS_S) + 2)
        self.overruns = 0


class SerialPort(Protocol):
    """A serial line to a microcontroller or a sensor, which may be unplugged and come back.

    Attributes:
        opened: Number of times that it was opened; when it changes, a reader drops an incomplete message.
    """

    opened: int

    def read(self) -> bytes:
        """Return the bytes that have arrived, possibly none; never waits, and opens a line again that had gone."""
        ...

    def wait_until_ns(self, t_ns: int) -> None:
        """Return when bytes have arrived, at `t_ns` at the latest."""
        ...

    def write(self, data: bytes) -> None:
        """Send a few bytes; they are lost if the line has gone."""
        ...

    def close(self) -> None:
        """Release the line."""
        ...


class CanWire(Protocol):
    """A CAN interface; frames as in `firmware_interface.can.socketcan`."""

    def send(self, frames: bytes, t_ns: int) -> int:
        """Queue frames, as many as there is room for, without waiting.

        Args:
            frames: Whole frames behind each other.
            t_ns: Time of sending [ns]; only a virtual channel uses it.

        Returns:
            Number of frames queued, from the first on.

        Raises:
            OSError: The interface is down or gone, and so is every frame that it had not sent yet.
        """
        ...

    def receive(self) -> list[bytes]:
        """Return the frames that have arrived, oldest first, error frames included; never waits.

        Raises:
            OSError: The interface is down or gone.
        """
        ...

    def close(self) -> None:
        """Release the interface."""
        ...


class FrameSource(Protocol):
    """A source of readings: the scanner, or a recording."""

    def read(self) -> CapFrame | None:
        """Wait for the next frame and return it; None at the end of a recording."""
        ...

    def close(self) -> None:
        """Stop the conversions and release what is held."""
        ...


class ReferenceSensor(Protocol):
    """The multi-axis force sensor of a test stand."""

    def read(self, now_ns: int) -> Reference:
        """Return the samples that have arrived since the last call, oldest first, possibly none; never waits.

        Args:
            now_ns: Current time [ns], to which the samples' own times are mapped.

        Raises:
            SensorError: The bytes have the wrong framing or columns.
        """
        ...

    def close(self) -> None:
        """Release the port."""
        ...


class Window(NamedTuple):
    """The last three readings of every element of some feet, newest first.

    Attributes:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, 3, 9).
        age_s: Time from the middle of each conversion to the time that the load is asked for [s], same shape.
        missing: The imputed elements, shape (rows, elements).
    """

    closure_rel: Vector
    age_s: Vector
    missing: Mask


class Load(NamedTuple):
    """Estimated load of some feet, with standard deviations.

    Attributes:
        force_n: Ground reaction on the foot [N], foot frame, shape (rows, 3).
        sigma_n: Standard deviation of each component [N], same shape.
        contact_coordinates: Contact point on the ball, stereographic (normal_x, normal_y) / (1 + normal_z), and
            tangential over normal force, both forward and to the left [1], shape (rows, 4).
        contact_sigma: Standard deviation of each [1], same shape.
    """

    force_n: Vector
    sigma_n: Vector
    contact_coordinates: Vector
    contact_sigma: Vector


class Estimator(Protocol):
    """Estimates loads from the last readings of the feet: the network."""

    def estimate(self, window: Window) -> Load:
        """Return the estimated load of every row of the window."""
        ...


class ForceSink(Protocol):
    """The sink of forces, and source of commands."""

    def publish(self, frame: ContactFrame) -> None:
        """Send the forces of a cycle if due; what cannot be sent now is dropped and counted, never sent late."""
        ...

    def commands(self) -> list[Command]:
        """Return the commands that have arrived since the last call, oldest first; never waits."""
        ...

    def answer(self, outcome: CommandResult) -> None:
        """Send the result of a command to its sender."""
        ...

    def close(self) -> None:
        """Announce the end of the frames, and release the channel."""
        ...


class Observer(Protocol):
    """An observer of every cycle: recorder, metrics, run statistics, live table; it changes nothing."""

    def observe(self, cycle: Cycle) -> None:
        """Process one cycle; must return at once."""
        ...

    def close(self) -> None:
        """Flush and release what is held; by default nothing."""
        return
