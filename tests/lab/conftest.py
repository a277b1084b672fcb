"""One coarse foot for the whole directory, made once. Without the extra `lab` nothing is collected."""

import importlib.util
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from footsense.foot.response_table import FootResponse
    from footsense.lab.fem.adjoint import AdjointFields
    from footsense.lab.fem.quarter import Parity, QuarterFoot

collect_ignore_glob = [] if importlib.util.find_spec("ngsolve") else ["test_*.py", "*/test_*.py"]

#: Fixtures that mesh, solve or train for more than ten seconds; what asks for one is slow.
SLOW_FIXTURES = {"mesh", "quarters", "fields", "response", "built"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if SLOW_FIXTURES & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def mesh() -> Any:
    """Return the coarse mesh of the quarter."""
    import ngsolve

    from footsense.lab.fem.mesh import COARSE_MESH, build_mesh
    from tests.lab.released import FOOT_DESIGN

    ngsolve.SetNumThreads(1)  # a second thread that waits for a busy processor costs more than it gains
    return build_mesh(FOOT_DESIGN, COARSE_MESH)


@pytest.fixture(scope="session")
def quarters(mesh: Any) -> "dict[Parity, QuarterFoot]":
    """Return the factorised symmetry classes of the coarse foot."""
    from footsense.lab.fem.mesh import COARSE_MESH
    from footsense.lab.fem.quarter import SOLVED_CLASSES, QuarterFoot
    from tests.lab.released import FOOT_DESIGN

    return {parity: QuarterFoot(FOOT_DESIGN, COARSE_MESH, parity, mesh) for parity in SOLVED_CLASSES}


@pytest.fixture(scope="session")
def fields(quarters: "dict[Parity, QuarterFoot]") -> "dict[Parity, AdjointFields]":
    """Return their adjoint fields."""
    from footsense.lab.fem.adjoint import solve_cell_closure_fields

    return {parity: solve_cell_closure_fields(quarter) for parity, quarter in quarters.items()}


@pytest.fixture(scope="session")
def response(fields: "dict[Parity, AdjointFields]") -> "FootResponse":
    """Return the coarse foot's response table."""
    from footsense.lab.fem.mesh import COARSE_MESH
    from footsense.lab.response import tabulate_response
    from tests.lab.released import FOOT_DESIGN

    return tabulate_response(FOOT_DESIGN, COARSE_MESH, fields, {})
