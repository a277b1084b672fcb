"""What `footsense view` reads: the cycles in shared memory, and messages and headers of whoever connects."""

import fcntl
import json
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.frames import CanStatistics
from footsense.recording.shared_cycles import N_SLOTS, CycleReader, SharedCycleWriter
from footsense.view.access import is_allowed_origin, is_own_host
from footsense.view.page_messages import Request, decode_request
from tests.fuzz.outcome import TRIED, refusal
from tests.fuzz.test_texts import anything
from tests.support.cycles import LEGS, cycle


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return a file with some cycles."""
    path = tmp_path_factory.mktemp("cycles") / "cycles"
    shared = SharedCycleWriter(path, LEGS, {}, lambda: np.ones((6, 9)), CanStatistics())
    for number in range(5):
        shared.observe(cycle(number, warm=True, n_samples=2))
    content = path.read_bytes()
    shared.close()
    return content


def read(path: Path, content: bytes) -> str | None:
    """Read a file as if a service wrote it."""
    path.write_bytes(content)

    def reading() -> None:
        with closing(CycleReader(path)) as reader:
            assert len(reader.read().cycles) <= N_SLOTS
            assert reader.baseline_pf.shape == (len(reader.legs), 9)
            assert isinstance(reader.can_statistics, CanStatistics)

    with path.open("rb") as running:
        fcntl.flock(running, fcntl.LOCK_EX)
        return refusal(reading)


@given(data=st.data())
@TRIED
def test_any_shared_cycles(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    """Bytes set in header, numbers and records, and cuts: refused, or as many cycles as there are slots at most."""
    changed = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, 3000))
        if data.draw(st.booleans()):
            changed[at] = data.draw(st.integers(0, 255))
        else:
            changed[at : at + 8] = struct.pack(
                "<Q", data.draw(st.sampled_from([0, 1, 511, 2**31, 2**63, 2**64 - 1]))
            )
    read(tmp_path / "cycles", bytes(changed))
    assert read(tmp_path / "cycles", whole[: data.draw(st.integers(0, len(whole) - 1))])


@given(anything | st.just({"legs": "lf"}) | st.just({"legs": ""}))
@TRIED
def test_any_header(tmp_path: Path, header: object) -> None:
    """JSON of any kind in its place."""
    text = json.dumps(header).encode()
    read(tmp_path / "cycles", struct.pack("<8sQ", b"FSCYCLE1", len(text)) + text + bytes(5000))


@given(
    st.text(max_size=60)
    | st.binary(max_size=60)
    | anything.map(json.dumps)
    | st.builds(
        lambda kind, key, value: json.dumps({"type": kind, key: value}),
        st.sampled_from(["drawn", "chunk", "x"]),
        st.sampled_from(["number", "x"]),
        anything,
    )
)
@TRIED
def test_any_message_of_a_page(message: str | bytes) -> None:
    """A request, or a `ValueError`, by which the server dismisses the page."""
    refused = refusal(lambda: decode_request(message), ValueError)
    assert refused is not None or isinstance(decode_request(message), Request)


@given(
    st.text(max_size=30) | st.sampled_from(["[", "[::1", "127.0.0.1:x", "robot@evil", "//", "1.2.3.4:99999"])
)
@TRIED
def test_any_host_and_origin(header: str) -> None:
    """A name that is not ours never is, whatever the header looks like."""
    is_own_host(header, ["localhost"])
    assert not is_own_host(f"x{header.replace('.', '').replace(':', '')}", ["localhost"])
    assert is_allowed_origin(header, "127.0.0.1:8765") == (
        header in {f"http{s}://127.0.0.1:8765" for s in ("", "s")}
    )
