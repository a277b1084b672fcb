"""Fabrication processes of a foot's sheet: films in stock, smallest dimensions, tolerances."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from footsense.strict_yaml import load

#: The table that comes with the lab.
PROCESSES_TABLE = Path(__file__).with_name("processes.yaml")

_Positive = Annotated[float, Meta(gt=0.0, le=1000.0)]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class Film(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An insulating film: thickness [um] and relative permittivity [1]."""

    um: _Positive
    eps_r: Annotated[float, Meta(ge=1.0, le=100.0)]


class Process(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Fabrication process of a foot's sheet: feasible dimensions and tolerances.

    Attributes:
        about: Short description.
        source: Origin of the numbers.
        plate_mm: Thicknesses of a plate [mm].
        gap_um: Gaps that can be made [um].
        film: Films between the electrodes.
        fill_rel: Sides of an electrode over the pitch [1].
        bar_mm: Narrowest bar of the spacer, which has to bond [mm].
        gap_tolerance_um: Rms deviation of a gap, constant part [um].
        gap_tolerance_rel: Rms deviation of a gap, part in proportion to it [1].
        film_tolerance_um: Rms deviation of a film [um].
        stray_tolerance_pf: Rms unknown stray of an element [pF].
        stiffness_tolerance_rel: Rms deviation of the stiffness of a foot [1].
        mount_tolerance_deg: Rms rotation of a foot on its leg [deg].
    """

    about: str
    source: str
    plate_mm: Annotated[tuple[_Positive, ...], Meta(min_length=1)]
    gap_um: Annotated[tuple[_Positive, ...], Meta(min_length=1)]
    film: Annotated[tuple[Film, ...], Meta(min_length=1)]
    fill_rel: Annotated[tuple[Annotated[float, Meta(gt=0.0, lt=1.0)], ...], Meta(min_length=1)]
    bar_mm: _Positive
    gap_tolerance_um: Annotated[float, Meta(ge=0.0)]
    gap_tolerance_rel: _Share
    film_tolerance_um: Annotated[float, Meta(ge=0.0)]
    stray_tolerance_pf: Annotated[float, Meta(ge=0.0)]
    stiffness_tolerance_rel: _Share
    mount_tolerance_deg: Annotated[float, Meta(ge=0.0, le=20.0)]


def load_processes(path: Path = PROCESSES_TABLE) -> dict[str, Process]:
    """Return the fabrication processes of a YAML table, by name.

    Raises:
        ConfigError: It is missing or does not fit.
    """
    return load(path, dict[str, Process])
