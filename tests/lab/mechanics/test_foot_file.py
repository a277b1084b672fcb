"""A foot's description: an error names line, path and a right value."""

from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from footsense.cli.lab.group import lab
from footsense.errors import ConfigError, FootsenseError
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.foot_file import FOOT_FILE, load_foot
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

TEXT = (RELEASED / FOOT_FILE).read_text()


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "pitch_mm: 5",
            "pitch_mm: 4",
            ":10: electrode_mm: electrodes of 4 mm overlap at a pitch of 4 mm",
        ),
        (
            "sheet_mm: 14",
            "sheet_mm: 13",
            ":6: sheet_mm: an array of 14 mm does not fit .* use at least 14",
        ),
        (
            "electrode_mm: 4",
            "electrode_mm: 3.98",
            ":6: sheet_mm: a sheet of 14 mm leaves 0.01 mm of spacer .* use 13.98, or at least 14.98",
        ),
        (
            "sheet_mm: 14",
            "sheet_mm: 15",
            ":6: sheet_mm: the corners .* overhang a ball .* less than 14.14",
        ),
        ("gap_um: 20", "gap_um: 40", ":11: gap_um: a gap of 40 um is thicker than the spacer of 37 um"),
        ("spacer_mm: 0.037", "spacer_mm: 0.05", ":8: spacer_mm: .* which fill 37 um; use at most 0.037"),
        ("max_n: 2.0", "max_n: 20", ":21: loads.max_n: 20 N flatten 16 deg .* use at most 10.6"),
        (
            "gap_um: 20",
            "gap_um: 20 um",
            ':11: gap_um: "20 um" is wrong; it has to be a number',
        ),
        (
            "poisson: 0.49",
            "poisson: 0.5",
            ":16: rubber.poisson: 0.5 is wrong; .* above 0, below 0.5 .*rubber has 0.49",
        ),
        ("pitch_mm: 5", "pitch_um: 5", ":9: pitch_um: unknown key; did you mean pitch_mm"),
        ("cavity: vented\n", "", "the key cavity is missing: one of vented"),
        ("cavity: vented", "cavity: open", ":14: cavity: 'open' is none of vented"),
        (
            "cavity: vented",
            "cavity: vented\ngold: {thickness_um: 0.1, youngs_mpa: 79000, poisson: 0.6}",
            ":15: gold.poisson: 0.6 is wrong; .*gold has 0.42",
        ),
        (
            "foot_type: aoyagi-3x3",
            "foot_type: Aoyagi 3x3",
            ":2: foot_type: .*small letters, digits and hyphens",
        ),
        (
            "min_elevation_deg: 30",
            "min_elevation_deg: 20",
            "loads.min_elevation_deg: 20 is wrong; .* from 25 to 80 .*table begins at 25 deg",
        ),
    ],
)
def test_what_cannot_be_is_refused(old: str, new: str, line: str) -> None:
    """One line: where, what is wrong, what would be right."""
    assert old in TEXT
    with pytest.raises(ConfigError, match=line):
        load_foot(TEXT.replace(old, new).encode())


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ((10, 14, 5, 1.3), r"an element has 0\.57 pF unloaded, too little to differ .* at least 1 pF"),
        (
            (30, 40, 10, 8),
            r"an element has 34\.8 pF with its gap half closed, the converter reads up to 16\.0 pF",
        ),
    ],
)
def test_electrodes_that_the_converter_cannot_read_are_refused(sizes: tuple[float, ...], said: str) -> None:
    """Too little beside an open line, and too much once pressed: ball, sheet, pitch, electrode [mm]."""
    names = ("ball_radius_mm", "sheet_mm", "pitch_mm", "electrode_mm")
    foot_design = replace(FOOT_DESIGN, **dict(zip(names, sizes, strict=True)))
    with pytest.raises(ConfigError, match=f"electrode_mm: {said}"):
        load_foot(msgspec.json.encode(foot_design))


def test_the_shipped_foot_is_meshed_by_the_stated_lengths() -> None:
    """Lengths of a mesh are those in the shipped foot, to the bit: its table must not change."""
    for size in (COARSE_MESH, RELEASED_MESH):
        assert size.scaled_to_foot(FOOT_DESIGN) == size


def test_another_foot_of_a_known_name_is_refused(tmp_path: Path) -> None:
    """Two networks of one name could not be told apart: refused before the solve."""
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT.replace("electrode_mm: 4", "electrode_mm: 2.9"))
    result = CliRunner().invoke(lab, ["build", "--foot", str(path), "--out", str(tmp_path)])
    assert isinstance(result.exception, FootsenseError)
    assert "describes another foot of the name aoyagi-3x3; give this one a name of" in str(result.exception)
