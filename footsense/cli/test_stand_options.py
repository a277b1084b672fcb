"""Options that the commands of a test stand share."""

from functools import partial
from pathlib import Path

import click

from footsense.calibration.evaluation import DesignModels
from footsense.daemon.foot_types import released
from footsense.errors import ConfigError
from footsense.estimation.network import Network
from footsense.foot.response_table import FootResponse

__all__ = ["design_models", "foot_option", "foot_type_option", "recordings_argument"]

recordings_argument = click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
foot_option = click.option("--foot", required=True, help="The foot on the test stand, such as foot-0007.")
foot_type_option = click.option(
    "--foot-type",
    "foot_type_folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder with network.onnx and response.npz of the foot's type; by default the released one.",
)


def design_models(foot_type: str, folder: Path | None) -> tuple[DesignModels, Path, Path]:
    """Return the models of a foot type, and the files of its network and response table.

    Args:
        foot_type: Its name, as recorded.
        folder: Folder of the files; None for the released ones.

    Raises:
        ConfigError: They are missing, or of another type.
    """
    remedy = "--foot-type names the folder that `footsense lab build --foot` made"
    folder = folder or released("network.onnx", foot_type).parent
    network, response = folder / "network.onnx", folder / "response.npz"
    for path in (network, response):
        if not path.is_file():
            raise ConfigError(f"{folder}: no foot type {foot_type}: there is no {path.name} in it; {remedy}")
    card = Network(network, 1).card
    if card.foot_type != foot_type:
        raise ConfigError(f"{folder}: of foot type {card.foot_type!r}, recorded is {foot_type!r}; {remedy}")
    models = DesignModels(FootResponse.load(response), partial(Network, network), card.trained_inputs)
    return models, network, response
