"""Command group `footsense lab`: model files of a foot, their errors, and the report. Needs the extra `lab`."""

from pathlib import Path

import click
import msgspec

from footsense.cli.lab import options
from footsense.cli.lab.design import design
from footsense.cli.lab.fabricate import couplings, fabricate
from footsense.cli.lab.walk import selection, selfcal, walk
from footsense.cli.options import FILE, FOLDER
from footsense.daemon.foot_types import released_path
from footsense.errors import FootsenseError, require

_RELEASED_MODELS = released_path("network.onnx").parent
#: Libraries of the extra.
_REQUIRED_PACKAGES = ("ngsolve", "jax", "jinja2", "joblib", "mujoco", "optax", "onnx", "scipy")


@click.command()
@click.option(
    "--foot", type=FILE, help="Description of the foot, a YAML file; without it the released one's."
)
@click.option(
    "--out",
    type=FOLDER,
    help="Folder in which the foot type's own folder is made; without it ./models, quick ones ./models-quick.",
)
@click.option("--quick", is_flag=True, help="Coarse mesh, short training: every step, no release.")
@click.option(
    "--from-nothing",
    is_flag=True,
    help="Train from random weights, for a foot that closes unlike the released ones; five times as long.",
)
def build(*, foot: Path | None, out: Path | None, quick: bool, from_nothing: bool) -> None:
    """Build the models of a foot, and print their errors.

    Solves the foot, trains its network, and writes both with their card.
    """  # noqa: DOC501
    if quick and from_nothing:
        raise click.UsageError("--quick and --from-nothing exclude each other")
    from footsense.lab.foot_file import FOOT_FILE, load_foot

    description = foot or released_path(FOOT_FILE)
    foot_design = load_foot(description)
    folder = (out or Path("models-quick" if quick else "models")) / foot_design.foot_type
    for file in (folder / FOOT_FILE, released_path(FOOT_FILE, foot_design.foot_type)):
        if file.exists() and msgspec.structs.replace(load_foot(file), about=foot_design.about) != foot_design:
            raise FootsenseError(
                f"{description}: foot_type: {file} describes another foot of the name {foot_design.foot_type}; "
                "give this one a name of its own, or remove that folder"
            )
    options.ensure_writable_folder(folder)
    from footsense.lab import build as lab_build
    from footsense.lab.evaluation.evaluate_models import as_markdown

    long = lab_build.BUILD_FROM_NOTHING if from_nothing else lab_build.FULL_BUILD
    report = options.elapsed_time_reporter()
    built = lab_build.build(description, folder, lab_build.QUICK_BUILD if quick else long, report)
    report(f"wrote {folder}; JAX and ONNX Runtime differ by at most {1000 * built.onnx_difference_n:.4f} mN")
    click.echo(as_markdown(built.error_table))


@click.command()
@click.argument("name")
@click.option(
    "--models",
    type=FOLDER,
    help="Folder of a foot type, as `lab build` makes it; without it the released one's.",
)
@options.output_option
@options.quick_option
@click.option("--data", type=FOLDER, help="Folder of measured data of others, which real-sensors needs.")
def study(*, name: str, models: Path | None, output: Path | None, quick: bool, data: Path | None) -> None:
    """Make the page NAME of the report, and its figures as NAME.json. Another name lists them all."""
    from footsense.lab.report import StudyContext, make_page, write_list_of_pages

    folder = options.ensure_report_folder(output, quick=quick)
    context = StudyContext(models or _RELEASED_MODELS, quick, data, options.elapsed_time_reporter())
    markdown, _ = make_page(name, context, folder)
    if models is None:
        write_list_of_pages(folder)
    click.echo(f"{markdown}\nwrote {folder / name}.md")


@click.command()
@options.output_option
@options.quick_option
@click.option(
    "--text", "text_only", is_flag=True, help="Compute nothing: write the pages' text from their figures."
)
def report(*, output: Path | None, quick: bool, text_only: bool) -> None:
    """Make all pages of the report anew, about the released foot.

    With --text, pages whose models, tables or robots are others today say so on top.
    """
    from footsense.lab.report import StudyContext, make_report, write_list_of_pages, write_texts

    folder = options.ensure_report_folder(output, quick=quick)
    if text_only:
        for path in write_texts(folder):
            click.echo(path)
        write_list_of_pages(folder)
        return
    progress = options.elapsed_time_reporter()
    context = StudyContext(_RELEASED_MODELS, quick, report_progress=progress)
    progress(f"wrote {make_report(folder, context, progress)}")


@click.group(
    commands=[design, build, fabricate, couplings, walk, selection, selfcal, study, report],
    context_settings={"show_default": True},
)
@click.pass_context
def lab(ctx: click.Context) -> None:
    """From rubber to network: design, build and draw a foot, and study it."""
    if ctx.invoked_subcommand != walk.name:  # which has an extra of its own
        require("the lab", "lab", *_REQUIRED_PACKAGES, note=" (there is no ngsolve for ARM)")
