"""One coarse solid for the whole directory: two seconds, made once. Without the extra `lab` nothing is collected."""

import importlib.util
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from footsense.lab.adjoint import SurfaceField
    from footsense.lab.solid import Solid
    from footsense.sim.foot import FootResponse

collect_ignore_glob = [] if importlib.util.find_spec("ngsolve") else ["test_*.py"]


@pytest.fixture(scope="session")
def solid() -> "Solid":
    """Return the factorised coarse foot."""
    import ngsolve

    from footsense.lab.geometry import SoleDesign
    from footsense.lab.solid import COARSE, Solid

    ngsolve.SetNumThreads(2)
    return Solid(SoleDesign(), COARSE)


@pytest.fixture(scope="session")
def field(solid: "Solid") -> "SurfaceField":
    """Return its adjoint fields."""
    from footsense.lab.adjoint import influence_field

    return influence_field(solid)


@pytest.fixture(scope="session")
def response(solid: "Solid", field: "SurfaceField") -> "FootResponse":
    """Return its response table."""
    from footsense.lab.response import make_response

    return make_response(solid, field)
