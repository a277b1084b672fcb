"""`footsense lab fabricate`: fabrication files of a foot (STEP, Gerber, DXF, documents)."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab import options
from footsense.cli.lab.foot_argument import foot_description_path
from footsense.cli.options import FOLDER
from footsense.errors import ConfigError, require

if TYPE_CHECKING:
    from footsense.lab.fabrication.parts.flex import Board

#: Libraries of the extra `fabrication`.
_REQUIRED_PACKAGES = ("ezdxf", "shapely")


@click.command()
@click.argument("foot")
@click.option("--out", type=FOLDER, required=True, help="Folder for the files.")
@click.option(
    "--process",
    help="As for `lab design`; without it the first that has the foot's film.",
)
@click.option(
    "--board",
    type=click.Choice(["ad7147", "fdc1004"]),
    default="ad7147",
    show_default=True,
    help="Electronics of the foot: a converter with a line for each element, or one for rows and columns.",
)
def fabricate(*, foot: str, out: Path, process: str | None, board: "Board") -> None:
    """Write the files that a foot is made from.

    STEP, Gerber, DXF, parts, tolerances, steps, checklist.

    FOOT is a foot.yaml, a folder with one, or the name of a released foot type. README.md in the folder says
    what goes to whom.
    """  # noqa: DOC501 - click shows this text
    require("lab fabricate", "lab,fabrication", *_REQUIRED_PACKAGES)
    from footsense.lab.fabrication.package import write_fabrication_package as write_package
    from footsense.lab.foot_file import load_foot

    path = foot_description_path(foot)
    design = load_foot(path)
    options.ensure_writable_folder(out)
    try:
        package = write_package(design, out, process, board)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    element = package.expected
    range_pf = f"{element.min_unloaded_pf:.2f} to {element.max_unloaded_pf:.2f}"
    click.echo(
        f"wrote {out}, board {board}, process {package.assumed.process_name}: elements of "
        f"{element.unloaded_pf:.2f} pF ({range_pf}), {element.plate_formula_pf:.2f} as designed and "
        f"{element.fringe_pf:.2f} of the field at their edges"
    )
