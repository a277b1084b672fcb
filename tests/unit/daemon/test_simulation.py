"""What a simulated robot cannot be: each a line that names the key or the file."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from footsense.config import DEFAULT
from footsense.daemon.simulation import simulated_robot
from footsense.errors import ConfigError, ModelError
from footsense.sim.faults.scene_faults import BrokenRow, ElementOpen
from footsense.sim.scene_files import load_scene
from tests.support.arrays import response


def test_a_foot_of_another_array_than_the_configured_is_refused(tmp_path: Path) -> None:
    """The line names the table, its array, and what to set."""
    folder = tmp_path / "test-4"
    folder.mkdir()
    response(4).save(folder / "response.npz")
    with pytest.raises(
        ModelError, match=r"response.npz: made for 4 x 4 elements, the configuration has 3 x 3; set rows: 4"
    ):
        simulated_robot(replace(DEFAULT, foot_type=str(folder)), load_scene("hanging"))


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (
            ElementOpen(leg="lf", at_s=1.0, element=9),
            r"faults\[0\].element: 9 is no element of this foot.* 0 to 8",
        ),
        (BrokenRow(leg="lf", at_s=1.0, row=3), r"faults\[0\].row: 3 is no row of this foot; it has 0 to 2"),
    ],
)
def test_a_fault_of_a_place_that_the_foot_does_not_have_is_refused(
    fault: ElementOpen | BrokenRow, line: str
) -> None:
    """A scene may name elements of the largest array; the foot decides."""
    scene = replace(load_scene("hanging"), faults=(fault,))
    with pytest.raises(ConfigError, match=line):
        simulated_robot(DEFAULT, scene)
