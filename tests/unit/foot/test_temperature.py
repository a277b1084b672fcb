"""Forces of a foot that is warmer than when it was calibrated."""

import numpy as np
import pytest

from footsense.foot.parameters import (
    STIFFNESS_PER_K,
    UNKNOWN_TEMPERATURE_SIGMA_REL,
    force_factor_and_uncertainty,
)
from footsense.sim.rubber import STIFFENING_PER_K, relative_compliance_when_warmed


@pytest.mark.parametrize("kelvin", [-40.0, -20.0, 5.0, 20.0, 60.0])
def test_the_gain_undoes_what_the_temperature_did(kelvin: float) -> None:
    """A warmed foot yields less by `relative_compliance_when_warmed`, and its force is read too small by the same."""
    gain, _ = force_factor_and_uncertainty(23.0 + kelvin, 23.0)
    assert relative_compliance_when_warmed(kelvin) * gain == pytest.approx(1.0, abs=1e-12)
    assert STIFFNESS_PER_K == STIFFENING_PER_K


def test_the_unknown_temperature_widens_sigma_by_what_it_does_to_forces() -> None:
    """The root mean square error over the range, within what the stiffness's curvature adds."""
    kelvin = np.linspace(-10.0, 10.0, 2001)
    errors_rel = np.array([relative_compliance_when_warmed(k) for k in kelvin.tolist()]) - 1.0
    assert pytest.approx(np.sqrt(np.mean(errors_rel**2)), rel=0.02) == UNKNOWN_TEMPERATURE_SIGMA_REL


@pytest.mark.parametrize("temperature_c", [float("nan"), -273.0, 126.0])
def test_what_is_no_temperature_corrects_nothing(temperature_c: float) -> None:
    """A stand-in for a temperature would be a wrong force."""
    assert force_factor_and_uncertainty(temperature_c, 23.0) == (
        1.0,
        UNKNOWN_TEMPERATURE_SIGMA_REL,
    )
