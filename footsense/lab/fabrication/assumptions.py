"""Fabrication process that a foot's design assumed, with its rms deviations."""

from dataclasses import dataclass

from footsense.errors import ConfigError, FootsenseError
from footsense.lab.design.inputs.processes import Process, load_processes
from footsense.lab.design.prediction.after_calibration import gap_sigma_um
from footsense.lab.geometry import FootDesign
from footsense.sim.fabrication import FootTolerances


@dataclass(frozen=True, slots=True)
class AssumedProcess:
    """Manufacturing process of a foot, and the rms deviations it causes.

    Attributes:
        process_name: Its name in the table of `footsense lab design`.
        process: What it can make, and how well.
        rms_deviations: Rms deviations of feet that it makes.
    """

    process_name: str
    process: Process
    rms_deviations: FootTolerances


def assumed_process(design: FootDesign, name: str | None = None) -> AssumedProcess:
    """Return the manufacturing assumptions of a foot's design.

    Args:
        design: The foot.
        name: Name of the process; None for the first that has the foot's film.

    Raises:
        FootsenseError: There is no such process.
        ConfigError: No process has this film; the message begins with the key.
    """
    known = load_processes()
    if name is None:
        name = next((n for n, process in known.items() if _has_film(process, design)), None)
        if name is None:
            films = (
                f"{film.um:g} um of {film.eps_r:g} ({n})"
                for n, process in known.items()
                for film in process.film
            )
            raise ConfigError(
                f"film_um: no process has a film of {design.film_um:g} um with a permittivity of "
                f"{design.film_eps_r:g}; use {', '.join(films)}, or name the process with --process"
            )
    if name not in known:
        raise FootsenseError(f"--process {name}: not in the table, which has {', '.join(known)}")
    process = known[name]
    rms_deviations = FootTolerances(
        gap_um=gap_sigma_um(process, design.gap_um),
        film_um=process.film_tolerance_um,
        stray_pf=process.stray_tolerance_pf,
        stiffness_rel=process.stiffness_tolerance_rel,
        mount_deg=process.mount_tolerance_deg,
    )
    return AssumedProcess(name, process, rms_deviations)


def _has_film(process: Process, design: FootDesign) -> bool:
    """Return whether a fabrication process offers the foot's film."""
    return any((film.um, film.eps_r) == (design.film_um, design.film_eps_r) for film in process.film)
