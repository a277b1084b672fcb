"""What the page of the reference firmware says of its gain."""

import pytest

from tests.firmware import gain


@pytest.mark.slow
def test_forces_are_as_good_and_as_young_as_over_the_i2c_of_the_computer() -> None:
    linux, (mcu, _) = gain.on_linux(), gain.on_mcu()
    assert linux.usable_rel == mcu.usable_rel == 1.0
    assert mcu.rms_mn == pytest.approx(linux.rms_mn, rel=0.15)
    assert mcu.age_ms == pytest.approx(3.8, abs=0.3)
    assert linux.age_ms == pytest.approx(3.0, abs=0.3)
