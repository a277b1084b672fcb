"""Configuration of the daemon: objects parsed from `--config FILE`, and the built-in simulation.

`footsense.daemon` passes plain values on: no package below it imports this one.
"""

from pathlib import Path

from msgspec.structs import replace

from footsense.can.interface import Can
from footsense.config.contradictions import first_contradiction, missing_folder
from footsense.config.schema import Config, gone_board
from footsense.config.sections import Bus, Mux, ResetLine
from footsense.strict_yaml import Problem, load

__all__ = ["DEFAULT", "SMALL_BOARD", "Config", "load_config"]

#: Simulated robot of six legs with a converter in every foot, behind one multiplexer; CAN within the process.
SMALL_BOARD = Config(
    board="fdc1004",
    buses=(
        Bus(
            device="sim",
            mux=Mux(reset=ResetLine(device="sim", line=0)),
            legs={"lf": 0, "lm": 1, "lr": 2, "rf": 3, "rm": 4, "rr": 5},
        ),
    ),
    can=Can(interface="virtual"),
)

#: Simulation that runs without a file: six legs with an AD7147 in every foot, three on each of two buses.
DEFAULT = Config(
    buses=(
        Bus(device="sim0", addresses={"lf": 0x2C, "lm": 0x2D, "lr": 0x2E}),
        Bus(device="sim1", addresses={"rf": 0x2C, "rm": 0x2D, "rr": 0x2E}),
    ),
    can=Can(interface="virtual"),
)


def load_config(path: Path) -> Config:
    """Load the daemon's configuration from a YAML file.

    Args:
        path: The file.

    Returns:
        The configuration, with `model`, `calibrations` and the folder of `foot_type` resolved against the directory of
        the file.

    Raises:
        ConfigError: The file is missing, is not such YAML, does not fit, contradicts itself, or a folder is missing.
    """
    parent = path.parent.absolute()

    def check(config: Config) -> Problem | None:
        return first_contradiction(config) or missing_folder(config, parent)

    config = load(path, Config, check=check, check_plain=_gone_problem)
    folder = config.foot_type if "/" in config.foot_type else None
    paths = {"model": config.model, "calibrations": config.calibrations, "foot_type": folder}
    return replace(config, **{key: str(parent / value) for key, value in paths.items() if value})


def _gone_problem(data: object) -> Problem | None:
    if gone := gone_board(data):
        return Problem("board", f"{gone}; use ad7147, fdc1004, or mcu for a microcontroller of your own")
    can = data.get("can") if isinstance(data, dict) else None
    if isinstance(can, dict) and "fd" in can:
        return Problem(
            "can.fd",
            "the frames of CAN FD are gone; take this key away: classic frames pass on a bus of CAN FD",
        )
    return None
