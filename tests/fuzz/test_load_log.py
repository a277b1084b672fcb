"""Logs of loads: damaged anywhere."""

from io import BytesIO
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from footsense.errors import ConfigError
from footsense.sim.loads.load_log import RepeatedLog
from tests.fuzz.outcome import TRIED, refusal


def whole() -> bytes:
    file, up = BytesIO(), np.tile([0.0, 0.0, 1.0], (20, 2, 1))
    np.savez(file, legs=np.array(["lf", "rf"]), t_s=np.arange(20.0), force_n=up, normal=up)
    return file.getvalue()


WHOLE = whole()


@given(data=st.data())
@TRIED
def test_damaged_anywhere(tmp_path: Path, data: st.DataObject) -> None:
    """A byte set or a cut: refused, or loads that are numbers."""
    damaged = bytearray(WHOLE)
    for _ in range(data.draw(st.integers(1, 3))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "walk.npz"
    path.write_bytes(damaged[: data.draw(st.sampled_from([len(damaged), len(damaged) // 2, 100]))])
    if refusal(lambda: RepeatedLog(path, 0), ConfigError) is None:
        for leg in RepeatedLog(path, 0)._row:
            assert np.isfinite(RepeatedLog(path, 0).contact(leg, 1_500_000_000)).all()
