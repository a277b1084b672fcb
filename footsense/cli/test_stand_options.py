"""What the commands of the bench share: where the network and the response table of a foot's type are."""

from pathlib import Path
from typing import NamedTuple

import click

from footsense import daemon
from footsense.errors import ConfigError
from footsense.estimation.network import Network
from footsense.foot.network_card import TrainedInputs

foot_type_option = click.option(
    "--foot-type",
    "foot_type_folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder with network.onnx and response.npz of the foot's type; without it, the released one.",
)


class FootFiles(NamedTuple):
    """What is known of a type of foot.

    Attributes:
        network: File of its network.
        response: File of its response table.
        trained_inputs: What the network's card says.
    """

    network: Path
    response: Path
    trained_inputs: TrainedInputs


def foot_files(foot_type: str, folder: Path | None) -> FootFiles:
    """Return the files of a foot type.

    Args:
        foot_type: Its name, as recorded.
        folder: Where they are; None for the released ones.

    Raises:
        ConfigError: They are not there, or are of another type.
    """
    remedy = "--foot-type names the folder that `footsense lab build --foot` made"
    folder = folder or daemon.released("network.onnx", foot_type).parent
    network, response = folder / "network.onnx", folder / "response.npz"
    for path in (network, response):
        if not path.is_file():
            raise ConfigError(f"{folder}: no foot type {foot_type}: there is no {path.name} in it; {remedy}")
    card = Network(network, 1).card
    if card.foot_type != foot_type:
        raise ConfigError(f"{folder}: of foot type {card.foot_type!r}, recorded is {foot_type!r}; {remedy}")
    return FootFiles(network, response, card.trained_inputs)
