"""Response tables: damaged, and packed so that they unpack to more than any has."""

import re
import zipfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from footsense.daemon.foot_types import released_path
from footsense.errors import ModelError
from footsense.foot.response_table import FootResponse
from tests.fuzz.outcome import TRIED, refusal

WHOLE = released_path("response.npz").read_bytes()
HEADS = [match.start() for match in re.finditer(b"PK", WHOLE)]


@given(data=st.data())
@TRIED
def test_damaged_anywhere(tmp_path: Path, data: st.DataObject) -> None:
    """A byte set, most of them in the headers of its parts, or a cut: refused, or the arrays have their shapes."""
    damaged = bytearray(WHOLE)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.sampled_from(HEADS)) + data.draw(st.integers(0, 250))
        damaged[min(at, len(damaged) - 1)] = data.draw(st.integers(0, 255))
    path = tmp_path / "response.npz"
    path.write_bytes(damaged[: data.draw(st.sampled_from([len(damaged), len(damaged) // 2, 100]))])
    refusal(lambda: FootResponse.load(path), ModelError)


def test_a_table_that_unpacks_to_gigabytes(tmp_path: Path) -> None:
    """Refused by the sizes that it declares, before anything is unpacked."""
    path = tmp_path / "response.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("description.npy", bytes(100 << 20))
    said = refusal(lambda: FootResponse.load(path), ModelError)
    assert said
    assert "unpacks to more" in said
