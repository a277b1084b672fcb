"""One coarse solid for the whole directory: two seconds, made once."""

import pytest

ngsolve = pytest.importorskip("ngsolve", reason="needs the extra `lab`")

from footsense.lab.adjoint import SurfaceField, influence_field  # noqa: E402
from footsense.lab.geometry import SoleDesign  # noqa: E402
from footsense.lab.response import make_response  # noqa: E402
from footsense.lab.solid import COARSE, Solid  # noqa: E402
from footsense.sim.foot import FootResponse  # noqa: E402


@pytest.fixture(scope="session")
def solid() -> Solid:
    """Return the factorised coarse foot."""
    ngsolve.SetNumThreads(2)
    return Solid(SoleDesign(), COARSE)


@pytest.fixture(scope="session")
def field(solid: Solid) -> SurfaceField:
    """Return its adjoint fields."""
    return influence_field(solid)


@pytest.fixture(scope="session")
def response(solid: Solid, field: SurfaceField) -> FootResponse:
    """Return its response table."""
    return make_response(solid, field)
