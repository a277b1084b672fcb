"""Calibrations of simulated feet that know them exactly: sigma is then that of a foot pressed today.

A simulated foot as designed has the sigma of one that nobody has calibrated, a fifth of the force and more, which would
cover nearly any disturbance.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from footsense import __version__
from footsense.calibration.writer import write_calibration
from footsense.clock import wall_time_iso
from footsense.config import Config
from footsense.daemon.estimation import mounted_feet
from footsense.daemon.models import load_models
from footsense.foot.calibration_files import Manifest
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import FootParameters
from footsense.foot.type_folders import foot_type_folder


def write_known(
    folder: Path, name: str, foot_type: str, parameters: FootParameters, made: str, sha256: str
) -> None:
    """Write the calibration of a foot with given parameters.

    Args:
        folder: Folder for the calibrations.
        name: Name of the foot.
        foot_type: Its type.
        parameters: Its parameters.
        made: Time of the calibration, UTC, ISO 8601.
        sha256: Hash of what it follows from.
    """
    manifest = Manifest(
        foot=name,
        foot_type=foot_type,
        footsense=__version__,
        made=made,
        n_loads=1,
        n_sessions=1,
        held_out=None,
        recordings={"simulation": sha256},
    )
    write_calibration(folder, manifest, parameters, foot_type_folder(foot_type) / NETWORK_FILE)


@contextmanager
def known_as_designed(config: Config) -> Iterator[Config]:
    """Give a robot with feet as designed calibrations of now that say so, during a `with` block.

    Args:
        config: The robot.

    Yields:
        The same with these calibrations.

    Raises:
        ModelError: The feet's network is missing.
    """
    models = load_models(config)
    feet, network = mounted_feet(models), models.network
    names = {leg: f"foot-{row:04}" for row, leg in enumerate(config.legs)}
    with TemporaryDirectory() as folder:
        for row, name in enumerate(names.values()):
            parameters = FootParameters(
                stray_pf=feet.stray_pf[row],
                unloaded_pf=feet.unloaded_pf[row] + feet.stray_pf[row],
                gap_um=feet.gap_um[row],
            )
            foot_type, sha256 = network.card.foot_type, network.card.response_sha256
            write_known(Path(folder), name, foot_type, parameters, wall_time_iso(), sha256)
        yield msgspec.structs.replace(config, feet=names, calibrations=folder)
