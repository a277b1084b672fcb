"""`footsense lab experiment`: simulation of the paper's experiment with fabricated feet."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from footsense.cli.lab.options import output_option
from footsense.cli.lab.study import run_and_write_study
from footsense.cli.options import json_option
from footsense.daemon.foot_types import foot_type_folder
from footsense.validation.test_stand_trial import FootBatch


@click.command()
@click.option("--feet", "n_feet", type=click.IntRange(min=1), help="How many; 20, 2 if quick.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=FootBatch().seed,
    show_default=True,
    help="Of all that is drawn.",
)
@click.option("--jobs", type=click.IntRange(min=1), help="Feet at a time; without it one for each processor.")
@click.option("--foot-type", help="A foot type, or its folder as `lab build --foot` makes it.")
@click.option(
    "--kept",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the loads of pressed feet, to go on with; build/experiment, none if quick.",
)
@click.option("--quick", is_flag=True, help="Two feet and a seventh of the presses, in a minute.")
@json_option
@output_option
def experiment(
    *,
    n_feet: int | None,
    seed: int,
    jobs: int | None,
    foot_type: str | None,
    kept: Path | None,
    quick: bool,
    as_json: bool,
    output: Path | None,
) -> None:
    """Simulate feet with the paper's fabrication tolerances, calibrate them, and compare all estimators.

    Every foot is read by the daemon through the bytes of its chips, and pressed at the paper's 362 and 180 loads beside
    a simulated reference sensor.
    """
    from footsense.cli.lab.pages.experiment import STUDY, compute

    batch = FootBatch(seed=seed, foot_type=foot_type or FootBatch().foot_type)
    own = replace(STUDY, compute=partial(compute, batch=batch, n_feet=n_feet, jobs=jobs, kept=kept))
    models, bound = foot_type_folder(batch.foot_type), foot_type is None
    run_and_write_study(own.compute_page, models, output, quick=quick, as_json=as_json, bound=bound)
