"""Records of a force sensor become forces on the foot in the daemon's time; missing ones are counted."""

import socket
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from footsense.config import SMALL_BOARD
from footsense.daemon.service import open_service
from footsense.errors import ReferenceSensorError
from footsense.frames import ReferenceSamples
from footsense.ports import SerialPort
from footsense.reference.net_ft import NetFtReference
from footsense.reference.sample_stream import SampleStream, SensorRecords
from footsense.reference.sensor_mounting import NEWTONS_PER_UNIT, SensorMounting
from footsense.reference.serial_sensor import LineDecoder, SerialReference
from footsense.sim.clock import VirtualClock
from footsense.sim.reference_sensor import (
    LINE_COLUMNS,
    LINE_TRANSMISSION_NS,
    SAMPLE_RATE_HZ,
    SimulatedForceSensor,
)
from footsense.sim.scene import load_scene
from tests.support.seen import Seen

AGAINST = {"x": "-x", "y": "-y", "z": "-z"}
PERIOD_NS = 5_000_000


def test_lines_are_read_and_others_counted() -> None:
    """The first line may have begun before; a short line, a word and a NaN are none."""
    decoder = LineDecoder(("sequence", "-", "fx", "fy", "fz"), "")
    text = b"7 8\r\n 1 x -2.5 1e-3 4\r\n2 ? 1 2\nfx fy fz a b\n3 0 nan 0 0\n4 0 0 0 1\n5 0"
    rows = decoder.feed(text)
    assert rows.raw_forces.tolist() == [[-2.5, 1e-3, 4.0], [0.0, 0.0, 1.0]]
    assert rows.sequence is not None
    assert rows.sequence.tolist() == [1, 4]
    assert (decoder.n_bad, decoder.last_bad) == (3, b"3 0 nan 0 0")
    assert len(decoder.feed(b" 0 0 2\n").raw_forces) == 1


def test_a_mounting_turns_scales_and_limits() -> None:
    """Axes with their signs, then the turn about z, in newtons; an axis at its end is saturated."""
    mounting = SensorMounting({"x": "-y", "y": "x", "z": "-z"}, (0.0, 0.0, 90.0), "kgf", 0.5, (4.0, 4.0, 8.0))
    force_n, saturated = mounting.to_foot_force_n(
        np.array([[2.0, 4.0, -6.0], [8.0, 0.0, 0.0], [0.0, 0.0, -16.0]])
    )
    # In counts of half a kgf: the sensor says (1, 2, -3) kgf; the axes make (-2, 1, 3) of it, the turn (-1, -2, 3).
    assert force_n[0] / NEWTONS_PER_UNIT["kgf"] == pytest.approx([-1.0, -2.0, 3.0])
    assert saturated.tolist() == [False, True, True]


def stream_of(rate_hz: float, latency_ns: int = 0) -> SampleStream:
    mounting = SensorMounting(AGAINST, (0.0, 0.0, 0.0), "gf", 1.0, (4000, 4000, 8000))
    return SampleStream("sensor", mounting, rate_hz, latency_ns)


class UnpluggableSensor(SimulatedForceSensor):
    """A simulated sensor that loses what it sends while it is unplugged."""

    unplugged = False

    def read(self) -> bytes:
        data = super().read()
        return b"" if self.unplugged else data


def simulated_stand(
    columns: tuple[str, ...] = LINE_COLUMNS,
) -> tuple[VirtualClock, UnpluggableSensor, SerialReference]:
    """Return a simulated sensor that feels one newton upwards, and what reads it."""
    clock = VirtualClock()
    clock.sleep_until_ns(10**12)
    port = UnpluggableSensor(lambda _: np.array([0.0, 0.0, 1.0]), clock, 3, 0.0)
    reference = SerialReference(
        port,
        LineDecoder(columns, ","),
        stream_of(SAMPLE_RATE_HZ, LINE_TRANSMISSION_NS),
        b"S",
    )
    return clock, port, reference


def watched(
    clock: VirtualClock, reference: SerialReference, seconds: float, look_ns: int = 24_400_000
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Look once a scan; return times and forces of all samples, shape (n, 4)."""
    parts = []
    for _ in range(round(seconds * 1e9 / look_ns)):
        clock.advance_ns(look_ns)
        said = reference.read(clock.now_ns())
        parts.append(np.column_stack([said.t_ns, said.force_n]))
    return np.concatenate(parts)


@pytest.mark.parametrize("columns", [LINE_COLUMNS, ("-", "fx", "fy", "fz")], ids=["stamped", "counted"])
def test_samples_have_the_time_at_which_they_were_taken(columns: tuple[str, ...]) -> None:
    """To a millisecond after a second, with a drifting clock and with none, though the loop looks once a scan."""
    clock, _, reference = simulated_stand(columns)
    samples = watched(clock, reference, 8.0)
    before = 4  # were in the line at the first look
    true_ns = 10**12 + PERIOD_NS * np.arange(1 + before, 1 + before + len(samples))
    late_ns = samples[:, 0] - true_ns
    assert np.abs(late_ns[250:]).max() < 1.2e6
    assert (np.diff(samples[50:, 0]) >= 0).all()
    assert reference.statistics.n_missing == 0
    assert samples[:, 3].mean() - 1.0 == pytest.approx(samples[0, 3] - 1.0, abs=0.4)  # but for its own zero


@pytest.mark.parametrize("columns", [LINE_COLUMNS, ("-", "fx", "fy", "fz")], ids=["stamped", "counted"])
def test_a_sensor_that_is_unplugged_is_missed_and_comes_back(
    columns: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    """The samples that it would have sent are counted, said once, and those that follow have their right times."""
    clock, port, reference = simulated_stand(columns)
    watched(clock, reference, 3.0)
    port.unplugged = True
    assert len(watched(clock, reference, 2.0)) == 0
    port.unplugged = False
    port.n_opened += 1
    samples = watched(clock, reference, 3.0)
    figures = reference.statistics
    assert figures.n_missing == pytest.approx(400, abs=8)
    assert figures.n_stream_starts == 2
    assert [record.getMessage()[:28] for record in caplog.records] == [
        "sensor: no sample for 0.5 s;",
        "sensor: sends again; " + caplog.records[-1].getMessage()[21:28],
    ]
    true_ns = clock.now_ns() - LINE_TRANSMISSION_NS - samples[-1, 0]
    assert -1e6 < true_ns < 1.2 * PERIOD_NS


@pytest.mark.parametrize("jumps_at", [20, 22, 700], ids=["at once", "between two looks", "later"])
def test_a_clock_that_jumps_is_followed_anew(jumps_at: int, caplog: pytest.LogCaptureFixture) -> None:
    """The times go on in ours, no sample is taken for missing, and it is said, however early the clock jumps."""
    stream = stream_of(200.0)
    none = np.zeros(1, np.bool_)
    mapped = []
    stream.convert(SensorRecords(np.zeros(0, np.int64), None, np.zeros((0, 3)), none[:0]), 0, 10**12 - 1, b"")
    for k in range(0, 1200, 4):
        taken_ns = 10**12 + PERIOD_NS * np.arange(k, k + 4)
        theirs_ns = taken_ns - 10**11 + np.where(np.arange(k, k + 4) >= jumps_at, 7_000_000_000, 0)
        now_ns = int(taken_ns[-1])
        said = stream.convert(
            SensorRecords(theirs_ns, None, np.zeros((4, 3)), np.zeros(4, np.bool_)), 80, now_ns, b""
        )
        mapped.append(int(said.t_ns[-1]) - now_ns)
    assert max(map(abs, mapped)) < 1_000_000
    assert (stream.statistics.n_samples, stream.statistics.n_missing) == (1200, 0)
    assert stream.statistics.n_clock_jumps == 1
    assert [record.getMessage() for record in caplog.records] == [
        "sensor: its clock has jumped; the clock map restarts"
    ]


@pytest.mark.parametrize(
    ("sent", "says"), [(b"", "nothing arrives for 3 s"), (b"\x00\xff7;8\n", "no record in")]
)
def test_a_sensor_that_makes_no_sense_ends_the_run(sent: bytes, says: str) -> None:
    """Silence from the beginning, and another format, are said in one line with what to check."""

    class Port(SimulatedForceSensor):
        def read(self) -> bytes:
            return sent

    clock, _, _ = simulated_stand()
    port = Port(lambda _: np.zeros(3), clock, 1)
    reference = SerialReference(port, LineDecoder(LINE_COLUMNS, ","), stream_of(200.0), b"S")
    with pytest.raises(ReferenceSensorError, match=says):
        watched(clock, reference, 20.0)


def test_the_simulated_sensor_is_that_of_the_data_sheet() -> None:
    """Steps of 4, 4 and 12 gf that a mean looks through, a bow of 1.5 % at most, an end at 4, 4 and 8 kgf."""
    rated_gf = np.array([4000.0, 4000.0, 8000.0])
    for seed in range(3):
        load_gf = np.zeros(3)

        clock = VirtualClock()
        sensor = SimulatedForceSensor(
            lambda _, load_gf=load_gf: load_gf * NEWTONS_PER_UNIT["gf"],  # type: ignore[misc]
            clock,
            seed,
        )
        sensor.write(b"S")
        read = {}
        for number, share in enumerate((0.0, 0.577, 1.2)):
            load_gf[:] = -share * rated_gf
            clock.sleep_until_ns((number + 1) * 3_000_000_000)
            lines = sensor.read().decode().split()[2:]
            read[share] = np.array([line.split(",")[1:] for line in lines], float)
        assert (read[0.0] % [4, 4, 12] == 0).all()
        bent_gf = read[0.577].mean(axis=0) - read[0.0].mean(axis=0) - 0.577 * rated_gf
        assert (np.abs(bent_gf) < 1.02 * 0.015 * rated_gf).all()
        assert np.abs(bent_gf).max() > 10.0
        assert (read[1.2] == rated_gf).all()


@pytest.fixture
def net_ft() -> Iterator[tuple[NetFtReference, socket.socket, Any]]:
    """A reference that has just asked for its stream, the socket of its sensor, and its own address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:
        sensor.bind(("127.0.0.1", 0))
        sensor.settimeout(5.0)
        mounting = SensorMounting(AGAINST, (0.0, 0.0, 0.0), "N", 1e-6, (100, 100, 100))
        stream = SampleStream("net", mounting, 1000.0, 0)
        reference = NetFtReference("127.0.0.1", sensor.getsockname()[1], stream)
        reference.read(0)
        asked, address = sensor.recvfrom(64)
        assert asked == bytes.fromhex("1234000200000000")
        yield reference, sensor, address


def test_a_net_ft_stream_is_asked_for_and_read(
    net_ft: tuple[NetFtReference, socket.socket, Any],
) -> None:
    """Requests as the protocol has them; lost, doubled and damaged packets are counted, and a status is no force."""
    reference, sensor, address = net_ft
    for number, status in ((1, 0), (2, 0), (2, 0), (4, 0), (5, 0x80010000)):
        force = (0, 2_000_000, -3_000_000, 0, 0, 0)
        sensor.sendto(struct.pack(">III6i", number, 7 * number, status, *force), address)
    sensor.sendto(b"short", address)
    said = reference.read(20_000_000)
    assert said.force_n.tolist() == [[0.0, -2.0, 3.0]] * 4
    assert said.saturated.tolist() == [False, False, False, True]
    assert np.diff(said.t_ns).tolist() == [1_000_000, 2_000_000, 1_000_000]
    figures = reference.statistics
    assert (figures.n_samples, figures.n_missing, figures.n_bad_records) == (4, 1, 2)
    reference.close()
    assert sensor.recv(64) == bytes.fromhex("1234000000000000")


def test_a_net_ft_that_counts_anew_is_asked_again(
    net_ft: tuple[NetFtReference, socket.socket, Any],
) -> None:
    """Whatever made its numbers go back, no sample is missing for longer than a second."""
    reference, sensor, address = net_ft
    said = []
    for tenth, number in enumerate([900, 901, *range(1, 20)]):
        sensor.sendto(struct.pack(">III6i", number, 0, 0, *[0] * 6), address)
        said.append(len(reference.read(100_000_000 * (tenth + 1)).t_ns))
    assert said[:3] == [1, 1, 0]
    assert said[-6:] == [1] * 6
    assert sensor.recvfrom(64)[0] == bytes.fromhex("1234000200000000")
    reference.close()


class OwnSensor:
    """A force sensor of one's own, as docs/calibrate-a-foot.md shows it: records of six bytes."""

    def __init__(self, port: SerialPort, stream: SampleStream) -> None:
        self._port, self._stream, self.statistics = port, stream, stream.statistics
        self.close = port.close

    def read(self, now_ns: int) -> ReferenceSamples:
        data = self._port.read()
        counts = np.frombuffer(data, "<i2").reshape(-1, 3)
        records = SensorRecords(None, None, counts.astype(float), np.zeros(len(counts), bool))
        return self._stream.convert(records, len(data), now_ns, data[:60])


def test_a_sensor_of_ones_own_is_recorded_by_the_service() -> None:
    """Its samples stand in the cycles, in newtons on the foot, at their times."""
    with open_service(SMALL_BOARD, load_scene("hanging"), real_time=False) as service:
        clock = service.clock

        class Port(SimulatedForceSensor):
            def read(self) -> bytes:
                return struct.pack("<3h", 0, 100, -200) * (clock.now_ns() > 10**7)

        port = Port(lambda _: np.zeros(3), clock, 1)
        mounting = SensorMounting(AGAINST, (0.0, 0.0, 0.0), "N", 0.01, (100, 100, 100))
        service.reference = OwnSensor(port, SampleStream("own", mounting, 400.0, 0))
        seen = Seen()
        service.observers.append(seen)
        service.run(until_ns=500_000_000)
    samples = [cycle.reference for cycle in seen.cycles if cycle.reference is not None]
    assert len(samples) == len(seen.cycles)
    force_n = np.concatenate([part.force_n for part in samples])
    assert len(force_n) > 100
    assert np.unique(force_n, axis=0).tolist() == [[0.0, -1.0, 2.0]]
    assert service.reference.statistics.n_samples == len(force_n)
