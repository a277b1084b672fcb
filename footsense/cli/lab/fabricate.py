"""`footsense lab fabricate` and `footsense lab couplings`: what is made of a foot's drawings."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab import options
from footsense.cli.options import FILE, FOLDER
from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError, ModelError, require

if TYPE_CHECKING:
    from footsense.lab.fabrication.parts.flex import Board


def _description_path(foot: str) -> Path:
    """Return the path of a foot's `foot.yaml`, from a foot type, a folder or the file.

    Raises:
        ModelError: There is none.
    """
    from footsense.lab.foot_file import FOOT_FILE

    candidates = [Path(foot), Path(foot) / FOOT_FILE]
    if "/" not in foot:
        candidates.append(released_path(FOOT_FILE, foot))
    for path in candidates:
        if path.is_file():
            return path
    known = sorted(path.parent.name for path in released_path(FOOT_FILE).parents[1].glob(f"*/{FOOT_FILE}"))
    raise ModelError(
        f"no foot {foot}: neither a file, nor a folder with {FOOT_FILE}, nor a released foot type ({', '.join(known)})"
    )


@click.command()
@click.argument("foot")
@click.option("--out", type=FOLDER, required=True, help="Folder for the files.")
@click.option("--process", help="As for `lab design`; without it the first that has the foot's film.")
@options.board_option(
    "Electronics of the foot: a converter with a line for each element, or one for rows and columns."
)
def fabricate(*, foot: str, out: Path, process: str | None, board: "Board") -> None:
    """Write the files that a foot is made from.

    STEP, Gerber, DXF, parts, tolerances, steps, checklist.

    FOOT is a foot.yaml, a folder with one, or the name of a released foot type. README.md in the folder says
    what goes to whom.
    """  # noqa: DOC501 - click shows this text
    require("lab fabricate", "lab,fabrication", "ezdxf", "shapely")
    from footsense.lab.fabrication.package import write_fabrication_package as write_package
    from footsense.lab.foot_file import load_foot

    path = _description_path(foot)
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


@click.command()
@click.argument("foot")
@click.option("--out", type=FILE, help="File of the table; without it couplings.yaml beside the foot.yaml.")
def couplings(*, foot: str, out: Path | None) -> None:
    """Compute the couplings of a foot's lines.

    From the flexes of each board as `lab fabricate` draws them: capacitances of every line to all others, to guards and
    to ground, and what grounded metal beside the tail adds. Scenes with `effects.couplings` use the table.

    FOOT is a foot.yaml, a folder with one, or the name of a released foot type.
    """
    require("lab couplings", "lab,fabrication", "shapely")
    from footsense.lab.couplings.flex_couplings import couplings_text
    from footsense.lab.foot_file import load_foot
    from footsense.sim.couplings import COUPLINGS_FILE

    path = _description_path(foot)
    file = out or path.parent / COUPLINGS_FILE
    file.write_text(couplings_text(load_foot(path)), encoding="utf-8")
    click.echo(f"wrote {file}")
