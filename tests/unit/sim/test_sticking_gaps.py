"""Gaps that stick once they have closed, and electrodes with a fringe field."""

from pathlib import Path

import numpy as np
import pytest

from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Foot
from footsense.frames import Vector
from footsense.sim.foot.sticking_gaps import StickingGaps
from footsense.sim.scene_files import load_scene

FOOT = Foot(FootResponse.load(released_path("response.npz")))
UP = np.array([0.0, 0.0, 1.0])
#: Up to a load that closes a part of every element, and down to none.
CYCLE_N = np.concatenate([np.linspace(0.0, 2.5, 7), np.linspace(2.5, 0.0, 7)])


def cycle_pf(stiction_kpa: float) -> Vector:
    """Return the mean capacitance over a load cycle [pF], shape (14,)."""
    gaps = StickingGaps(FOOT, stiction_kpa)
    return np.array([gaps.next_capacitance_pf(UP, force * UP).mean() for force in CYCLE_N])


def test_without_stiction_the_way_back_is_the_way_there() -> None:
    """And both are those of the foot without memory."""
    mean_pf = cycle_pf(0.0)
    plain_pf = [FOOT.capacitance_pf(UP[None], force * UP[None]).mean() for force in CYCLE_N]
    np.testing.assert_allclose(mean_pf, plain_pf, rtol=1e-12)
    np.testing.assert_allclose(mean_pf[:7], mean_pf[:6:-1], rtol=1e-12)


def test_what_sticks_opens_later_the_more_it_bears() -> None:
    """The way back lies above the way there; a little comes open again, what bears enough never."""
    little_pf, much_pf = cycle_pf(5.0), cycle_pf(1000.0)
    for mean_pf in (little_pf, much_pf):
        np.testing.assert_allclose(mean_pf[:7], cycle_pf(0.0)[:7], rtol=1e-12)
        assert (mean_pf[:6:-1] >= mean_pf[:7] - 1e-12).all()
    assert little_pf[-1] == pytest.approx(FOOT.unloaded_pf.mean(), rel=1e-12)
    assert (much_pf[8:-1] > little_pf[8:-1]).any()
    assert much_pf[-1] > 1.2 * FOOT.unloaded_pf.mean()


def test_the_fringe_of_the_released_electrodes() -> None:
    """0.456 pF by the solved field (study `solid`), and some 2 fF more for each um that the plates come together."""
    fringed = Foot(FOOT.response, Deviations(fringe=True))
    np.testing.assert_allclose(fringed.unloaded_pf - FOOT.unloaded_pf, 0.456, rtol=0.01)
    load = UP[None], UP[None]
    added_pf = fringed.capacitance_pf(*load) - FOOT.capacitance_pf(*load)
    assert (added_pf > 0.456).all()
    assert (added_pf < 0.48).all()


def test_stiction_needs_gaps_that_close(tmp_path: Path) -> None:
    """One line says what is missing."""
    path = tmp_path / "scene.yaml"
    path.write_text("description: sticks\nload: {kind: unloaded}\neffects: {stiction_kpa: 5}\n")
    with pytest.raises(ConfigError, match=r"effects\.stiction_kpa: needs gaps that close"):
        load_scene(str(path))
