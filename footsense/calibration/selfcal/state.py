"""State of the electrodes found while walking, one plain JSON file for each leg; written whole or not at all."""

from pathlib import Path
from typing import Annotated, Literal, Self

import msgspec
import numpy as np
from msgspec import Meta

from footsense.calibration.selfcal.instants import N_PARTS, Instants
from footsense.calibration.standing.fit import N_ELECTRODE_PARAMETERS, Electrodes
from footsense.calibration.twin import N_PARAMETERS
from footsense.errors import CalibrationError
from footsense.frames import ELEMENTS, Leg
from footsense.regular_file import read_regular, write_whole

_Of27 = Annotated[
    tuple[float, ...], Meta(min_length=N_ELECTRODE_PARAMETERS, max_length=N_ELECTRODE_PARAMETERS)
]
_N = N_ELECTRODE_PARAMETERS + ELEMENTS
_Of36 = Annotated[tuple[float, ...], Meta(min_length=_N, max_length=_N)]
_Of9 = Annotated[tuple[float, ...], Meta(min_length=ELEMENTS, max_length=ELEMENTS)]


class FootIdentity(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a state is of.

    Attributes:
        leg: The leg.
        foot: The foot on it; empty without a name.
        foot_type: Its type.
        board: Its electronics.
        calibration: Hash of the calibration in use; empty without one.
        since: Time of that calibration, UTC, ISO 8601; empty without one.
    """

    leg: Leg
    foot: str
    foot_type: str
    board: str
    calibration: str
    since: str


class KeptInstants(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Instants, as of `Instants`."""

    t_ns: tuple[int, ...]
    capacitance_pf: tuple[_Of9, ...]
    baseline_pf: tuple[_Of9, ...]
    sigma_pf: tuple[_Of9, ...]
    part: tuple[Annotated[int, Meta(ge=0, lt=N_PARTS)], ...]

    @classmethod
    def of(cls, instants: Instants) -> Self:
        """Return instants as plain values."""
        return cls(**{name: tuple(values.tolist()) for name, values in instants._asdict().items()})

    def instants(self) -> Instants:
        """Return the instants."""
        return Instants.joined([Instants(*map(np.array, msgspec.structs.astuple(self)))] if self.t_ns else [])

    def __post_init__(self) -> None:
        """Check that there is as much of each.

        Raises:
            ValueError: There is not.
        """
        if len({len(values) for values in msgspec.structs.astuple(self)}) > 1:
            raise ValueError("has more of one value than of another")


class SelfcalState(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """State of one foot.

    Attributes:
        format: Format of the file.
        of: What it is of.
        written: Time, UTC, ISO 8601.
        n_instants: Instants so far.
        saturated_rel: Share of the stances with an element beyond its range [1].
        turn_deg: By how much the electrodes turn forces against those in use [deg]; None before a fit.
        turn_sigma_deg: Standard deviation of it [deg].
        objection: Why they are not proposed as a calibration; empty if they are.
        parameters: Strays [pF], gains minus one [1] and gaps minus the design's [um].
        floor_pf: What the floor adds to each element of the foot in contact [pF].
        covariance: Covariance of both.
        kept: The newest instants.
    """

    format: Literal[2] = 2
    of: FootIdentity
    written: str
    n_instants: Annotated[int, Meta(ge=0)]
    saturated_rel: float
    turn_deg: float | None
    turn_sigma_deg: float | None
    objection: str
    parameters: _Of27
    floor_pf: _Of9
    covariance: Annotated[tuple[_Of36, ...], Meta(min_length=_N, max_length=_N)]
    kept: KeptInstants

    def electrodes(self) -> Electrodes:
        """Return what is known of the electrodes."""
        parameters = np.zeros(N_PARAMETERS)
        parameters[:N_ELECTRODE_PARAMETERS] = self.parameters
        return Electrodes(parameters, np.array(self.floor_pf), np.array(self.covariance))


def state_path(folder: Path, leg: str) -> Path:
    """Return the file of a leg's state in the folder of all states."""
    return folder / f"{leg}.json"


def read_state(path: Path) -> SelfcalState:
    """Return the state in a file.

    Raises:
        CalibrationError: It cannot be read, or is none.
    """
    try:
        return msgspec.json.decode(read_regular(path), type=SelfcalState)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise CalibrationError(f"{path}: is no state of `footsense selfcal`: {error}") from None


def write_state(folder: Path, state: SelfcalState) -> None:
    """Write a state under the name of its leg; the folder is created if missing.

    Raises:
        CalibrationError: It cannot be written.
    """
    path = state_path(folder, state.of.leg)
    try:
        write_whole(path, msgspec.json.encode(state))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written: {error.strerror}") from None


def other_foot(state: SelfcalState, of: FootIdentity) -> str:
    """Return in words what a state is of that a foot is not; empty if it is of this foot."""
    for name in FootIdentity.__struct_fields__:
        then, now = getattr(state.of, name), getattr(of, name)
        if then != now:
            return f"{name.replace('_', ' ')} {then or 'none'}, here is {now or 'none'}"
    return ""
