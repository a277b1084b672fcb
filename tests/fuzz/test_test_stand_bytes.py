"""Test stands: bytes of their sensors, files that describe them, and calibrations."""

import hashlib
import json
import socket
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface.serial_frames import FRAME_BYTES, Record, encode_record, pack_values, stuff
from footsense.acquisition.mcu_source import McuSource, Serial
from footsense.calibration.writer import write_calibration
from footsense.config.test_stand import load_test_stand
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE
from footsense.foot.calibration_files import MANIFEST, PARAMETERS, Manifest, read_calibration
from footsense.frames import Reading, ReferenceSamples
from footsense.reference.net_ft import NetFtReference
from footsense.reference.sample_stream import SampleStream
from footsense.reference.sensor_mounting import SensorMounting
from footsense.reference.serial_sensor import LineDecoder
from footsense.sim.clock import VirtualClock
from tests.fuzz.outcome import TRIED, anything, refusal
from tests.fuzz.test_texts import texts
from tests.support.calibrations import content

MOUNTING = SensorMounting({"x": "x", "y": "y", "z": "z"}, (0.0, 0.0, 0.0), "gf", 1.0, (100, 100, 100))
LINES = [
    ("time_s", "fx", "fy", "fz"),
    ("time_us", "-", "fx", "fy", "fz"),
    ("sequence", "fx", "fy", "fz", "saturated"),
]

numbers = st.sampled_from(
    ["0", "1", "-7.5", "1e300", "-1e308", "9" * 400, "9e18", "1e10", "nan", "inf", "", "\x00", "1_0", "0x1"]
)


def stream() -> SampleStream:
    return SampleStream("sensor", MOUNTING, 200.0, 0)


def played(decoder: LineDecoder, pieces: list[bytes]) -> None:
    """Play bytes to a decoder, look by look: what comes of them are numbers, or it is refused in a line."""
    sensor = stream()

    def play() -> None:
        for number, piece in enumerate(pieces):
            rows = decoder.feed(piece)
            sane(sensor.convert(rows, len(piece), (number + 1) * 25_000_000, decoder.last_bad))

    refusal(play)


def sane(said: ReferenceSamples) -> None:
    assert np.isfinite(said.force_n).all()
    assert len(said.t_ns) == len(said.force_n) == len(said.saturated)


@given(st.data(), st.sampled_from(LINES))
@TRIED
def test_any_lines(data: st.DataObject, columns: tuple[str, ...]) -> None:
    """Numbers of any size at the place of any other."""
    line = st.lists(numbers, min_size=len(columns), max_size=len(columns)).map(",".join)
    lines = data.draw(
        st.lists(line.map(lambda text: text.encode() + b"\n") | st.binary(max_size=30), max_size=20)
    )
    played(LineDecoder(columns, ","), lines)


@given(st.lists(st.binary(max_size=120) | st.binary(min_size=36, max_size=36), max_size=8))
@TRIED
def test_any_packets(packets: list[bytes]) -> None:
    """A stranger at the sensor's address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:
        sensor.bind(("127.0.0.1", 0))
        reference = NetFtReference("127.0.0.1", sensor.getsockname()[1], stream())

        def play() -> None:
            reference.read(1)
            _, address = sensor.recvfrom(64)
            for number, packet in enumerate(packets):
                sensor.sendto(packet, address)
                sane(reference.read((number + 1) * 25_000_000))

        refusal(play)
        reference.close()


STAND = (Path(__file__).parents[2] / "deploy/test-stand.yaml").read_text()


@given(data=st.data(), text=texts)
@TRIED
def test_any_test_stand_file(tmp_path: Path, data: st.DataObject, text: str) -> None:
    """Any text inside the description of a test stand."""
    at = data.draw(st.integers(0, len(STAND)))
    cut = data.draw(st.integers(at, min(at + 80, len(STAND))))
    path = tmp_path / "test-stand.yaml"
    path.write_bytes((STAND[:at] + text + STAND[cut:]).encode(errors="surrogatepass"))
    refusal(lambda: load_test_stand(path))


class _Line:
    """A line that hands over pieces, one a look."""

    n_opened = 1

    def __init__(self, clock: VirtualClock, pieces: list[bytes]) -> None:
        self._clock, self._pieces = clock, pieces

    def read(self) -> bytes:
        return self._pieces.pop(0) if self._pieces and self._clock.now_ns() > 10**9 else b""

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        self._clock.sleep_until_ns(min(t_ns, self._clock.now_ns() + 2_000_000))

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


whole_records = st.builds(
    Record,
    leg=st.integers(1, 6),
    seq=st.integers(0, 2**16 - 1),
    flags=st.integers(0, 3),
    step_us=st.integers(0, 2**16 - 1),
    t_us=st.integers(0, 2**32 - 1),
    values=st.lists(st.integers(-(2**31), 2**31 - 1), min_size=9, max_size=9).map(pack_values),
).map(encode_record)


@given(
    st.lists(
        whole_records | st.binary(max_size=FRAME_BYTES).map(lambda data: stuff(data) + b"\0"), max_size=30
    )
)
@TRIED
def test_any_records(pieces: list[bytes]) -> None:
    """Whole records in any order, with any times and values, and frames that are none: every frame says what it is."""
    clock = VirtualClock()
    source = McuSource(_Line(clock, [bytes(1), *pieces]), clock, Serial(device="sim", legs=("lf", "rr")))
    clock.sleep_until_ns(10**9)
    for _ in range(40):
        frame = source.read()
        read = (frame.reading == Reading.OK) | (frame.reading == Reading.OVER_RANGE)
        assert np.isnan(frame.capacitance_pf[frame.reading != Reading.OK]).all()
        assert np.isfinite(frame.capacitance_pf[frame.reading == Reading.OK]).all()
        assert (frame.t_ns[~read] == 0).all()
        assert frame.t_ns.max() <= clock.now_ns() + 9 * 65_535_000 + 10_000_000


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a calibration that is right."""
    return write_calibration(tmp_path_factory.mktemp("feet"), **content()).folder


def forged(calibration: Path, name: str, changed: bytes) -> None:
    """Put a file into a calibration, and all its hashes right."""
    (calibration / name).write_bytes(changed)
    manifest = msgspec.json.decode((calibration / MANIFEST).read_bytes(), type=Manifest)
    files = {**manifest.files, name: hashlib.sha256(changed).hexdigest()}
    manifest = msgspec.structs.replace(manifest, files=files)
    manifest = msgspec.structs.replace(manifest, sha256=manifest.computed_sha256)
    (calibration / MANIFEST).write_bytes(msgspec.json.encode(manifest))


@given(data=st.data(), value=anything, text=texts)
@settings(TRIED, max_examples=TRIED.max_examples // 3)
def test_any_calibration(calibration: Path, data: st.DataObject, value: object, text: str) -> None:
    """Parameters and manifests that say anything; parameters even with hashes that are right."""
    files = {name: (calibration / name).read_bytes() for name in (PARAMETERS, MANIFEST)}
    said = json.loads(files[PARAMETERS])
    key = data.draw(st.sampled_from(sorted(said)))
    number = data.draw(st.sampled_from(["1e999", "-1e308", "NaN", "1e400", "0", "-1"]))
    for changed in (
        json.dumps({**said, key: value}),
        json.dumps({**said, key: "?"}).replace('"?"', number),
        json.dumps({**said, key: "?"}).replace('"?"', f"[{', '.join([number] * 9)}]"),
        text,
    ):
        forged(calibration, PARAMETERS, changed.encode(errors="surrogatepass"))

        def read() -> None:
            found = read_calibration(calibration, DEFAULT_FOOT_TYPE).parameters
            assert np.isfinite(found.force_matrix).all()
            assert np.isfinite([found.error_rel, *found.gain_rel]).all()

        refusal(read)
    (calibration / PARAMETERS).write_bytes(files[PARAMETERS])
    said = json.loads(files[MANIFEST])
    key = data.draw(st.sampled_from(sorted(said)))
    for changed in (json.dumps({**said, key: value}), text):
        (calibration / MANIFEST).write_bytes(changed.encode(errors="surrogatepass"))
        refusal(lambda: read_calibration(calibration, DEFAULT_FOOT_TYPE))
    (calibration / MANIFEST).write_bytes(files[MANIFEST])
