"""From configuration to pipeline: which network, and what its card says about these feet."""

from pathlib import Path

import msgspec
import numpy as np

import footsense
from footsense.config import Can, Config
from footsense.core.baseline import TareLimits
from footsense.core.pipeline import Pipeline
from footsense.errors import ModelError, RecordingError
from footsense.frames import ELEMENTS
from footsense.inference.network import Network
from footsense.recording.replay import Replay

#: The foot that the released artefacts are for.
FOOT_TYPE = "aoyagi-3x3"


def released(name: str) -> Path:
    """Return the path of a released artefact: inside the installed package, or beside it in a checkout."""
    package = Path(footsense.__file__).parent
    installed = package / "models" / FOOT_TYPE / name
    return installed if installed.exists() else package.parent / "models" / FOOT_TYPE / name


def load_network(config: Config) -> Network:
    """Return the network that the configuration names, or the released one.

    Raises:
        ModelError: There is none, or it is made for another foot.
    """
    path = Path(config.model) if config.model else released("network.onnx")
    network = Network(path, n_legs=len(config.legs))
    if network.card.foot_type != FOOT_TYPE:
        raise ModelError(
            f"{path}: made for foot type {network.card.foot_type!r}, these feet are {FOOT_TYPE!r}"
        )
    return network


def pipeline_for(config: Config, network: Network, flags: int) -> Pipeline:
    """Return the pipeline of a robot whose frames carry these flags."""
    stray_pf = dict[str, tuple[float, ...]](config.stray_pf.items())
    return Pipeline(
        estimator=network,
        calibration=network.card.calibration,
        stray_pf=np.array([stray_pf.get(leg, (0.0,) * ELEMENTS) for leg in config.legs]),
        tare=TareLimits(
            window_frames=config.tare.window_frames,
            noise_limit_ff=config.tare.noise_limit_ff,
            unloaded_limit_rel=config.tare.unloaded_limit_rel,
        ),
        max_age_ns=config.max_age_ms * 1_000_000,
        flags=flags,
    )


def recorded_flags(recording: Replay) -> int:
    """Return the flags that every frame of a recording carries; without them in the header, none."""
    text = recording.header.get("flags", "")
    return int(text) if text.isdecimal() else 0


def recorded_config(recording: Replay) -> Config:
    """Return the configuration that a recording was made with, its CAN kept inside the process.

    Raises:
        RecordingError: The header holds none that this version reads.
    """
    try:
        config = msgspec.json.decode(recording.header["config"], type=Config)
    except (KeyError, msgspec.DecodeError) as error:
        raise RecordingError(
            f"{recording.path}: no configuration that this version reads: {error}"
        ) from error
    return msgspec.structs.replace(config, can=Can(interface="virtual"))
