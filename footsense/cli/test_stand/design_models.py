"""Models of the type of the feet in recordings."""

from pathlib import Path

from footsense.calibration.evaluation import DesignModels
from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.estimation.network import Network


def load_design_models(foot_type: str, folder: Path | None) -> tuple[DesignModels, Path]:
    """Load the models (network, response table) of a foot type; return them and their folder.

    Args:
        foot_type: Its name, as recorded.
        folder: Folder of the files; None for the released ones.

    Raises:
        ConfigError: They are missing, or of another type.
    """
    remedy = "--foot-type names the folder that `footsense lab build --foot` made"
    folder = folder or released_path("network.onnx", foot_type).parent
    for name in ("network.onnx", "response.npz"):
        if not (folder / name).is_file():
            raise ConfigError(f"{folder}: no foot type {foot_type}: there is no {name} in it; {remedy}")
    found = Network(folder / "network.onnx", 1).card.foot_type
    if found != foot_type:
        raise ConfigError(f"{folder}: of foot type {found!r}, recorded is {foot_type!r}; {remedy}")
    return DesignModels.load(folder), folder
