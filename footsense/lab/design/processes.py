"""Fabrication processes of a foot's sheet: films in stock, smallest dimensions, tolerances; that of a given foot."""

from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from footsense.errors import ConfigError, FootsenseError
from footsense.lab.geometry import FootDesign
from footsense.sim.fabrication import FootTolerances
from footsense.strict_yaml import load

#: The table.
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

    def rms_deviations(self, gap_um: float) -> FootTolerances:
        """Return the rms deviations of feet with a given gap [um]."""
        return FootTolerances(
            gap_um=float(np.hypot(self.gap_tolerance_um, self.gap_tolerance_rel * gap_um)),
            film_um=self.film_tolerance_um,
            stray_pf=self.stray_tolerance_pf,
            stiffness_rel=self.stiffness_tolerance_rel,
            mount_deg=self.mount_tolerance_deg,
        )


class AssumedProcess(NamedTuple):
    """Manufacturing process of a foot, and the rms deviations it causes.

    Attributes:
        process_name: Its name in the table of `footsense lab design`.
        process: What it can make, and how well.
        rms_deviations: Rms deviations of feet that it makes.
    """

    process_name: str
    process: Process
    rms_deviations: FootTolerances


def load_processes() -> dict[str, Process]:
    """Return the fabrication processes, by name.

    Raises:
        ConfigError: The table does not fit.
    """
    return load(PROCESSES_TABLE, dict[str, Process])


def named_process(name: str) -> Process:
    """Return the fabrication process of a name.

    Raises:
        FootsenseError: There is no such process.
    """
    known = load_processes()
    if name not in known:
        raise FootsenseError(f"--process {name}: not in the table, which has {', '.join(known)}")
    return known[name]


def assumed_process(design: FootDesign, name: str | None = None) -> AssumedProcess:
    """Return the manufacturing assumptions of a foot's design.

    Args:
        design: The foot.
        name: Name of the process; None for the first that has the foot's film.

    Raises:
        FootsenseError: There is no such process.
        ConfigError: No process has this film; the message begins with the key.
    """
    if name is None:
        stock = [(n, film) for n, process in load_processes().items() for film in process.film]
        wanted = Film(um=design.film_um, eps_r=design.film_eps_r)
        name = next((n for n, film in stock if film == wanted), None)
        if name is None:
            films = ", ".join(f"{film.um:g} um of {film.eps_r:g} ({n})" for n, film in stock)
            raise ConfigError(
                f"film_um: no process has a film of {design.film_um:g} um with a permittivity of "
                f"{design.film_eps_r:g}; use {films}, or name the process with --process"
            )
    process = named_process(name)
    return AssumedProcess(name, process, process.rms_deviations(design.gap_um))
