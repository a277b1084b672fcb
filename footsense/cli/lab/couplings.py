"""`footsense lab couplings`: the table of what lies beside the lines of a foot, for the simulator."""

from pathlib import Path

import click

from footsense.cli.lab.foot_argument import foot_description_path
from footsense.cli.options import FILE
from footsense.errors import require

#: Libraries of the extra `fabrication`.
_REQUIRED_PACKAGES = ("shapely",)


@click.command()
@click.argument("foot")
@click.option("--out", type=FILE, help="File of the table; without it couplings.yaml beside the foot.yaml.")
def couplings(*, foot: str, out: Path | None) -> None:
    """Compute the couplings of a foot's lines.

    From the flexes of each board as `lab fabricate` draws them: capacitances of every line to all others, to guards and
    to ground, and what grounded metal beside the tail adds. Scenes with `effects.couplings` use the table.

    FOOT is a foot.yaml, a folder with one, or the name of a released foot type.
    """
    require("lab couplings", "lab,fabrication", *_REQUIRED_PACKAGES)
    from footsense.lab.couplings.flex_couplings import couplings_text
    from footsense.lab.foot_file import load_foot
    from footsense.sim.couplings import COUPLINGS_FILE

    path = foot_description_path(foot)
    file = out or path.parent / COUPLINGS_FILE
    file.write_text(couplings_text(load_foot(path)), encoding="utf-8")
    click.echo(f"wrote {file}")
