"""Time constants with which air leaves a cavity: into the rubber, through a parylene wall, through a channel.

Source:
    Gas in PDMS: Merkel et al., Journal of Polymer Science B 38, 415, 2000. Parylene C: data sheet of Specialty Coating
    Systems, at 25 degC. Air between walls: Poiseuille flow.
"""

import numpy as np

from footsense.lab.fem.sealed_air import AMBIENT_KPA, ROOM_TEMPERATURE_K

#: Viscosity of air [Pa s].
AIR_VISCOSITY_PA_S = 1.8e-5
#: PDMS: diffusivity of nitrogen [m2/s], and air dissolved, in volumes at 1 atm per volume and atmosphere [1].
PDMS_M2_PER_S, PDMS_SOLUBILITY = 3.4e-9, 0.11
#: Permeability of parylene C to air, nitrogen and oxygen by their shares [m3(STP) m / (m2 s Pa)]; its thickness [m].
PARYLENE_PERMEABILITY, PARYLENE_M = 1.04e-19, 1e-6
#: Vent: a channel through a bar, as high as the gap; its width [mm].
VENT_CHANNEL_WIDTH_MM = 0.2


def sorption_half_time_s(gap_um: float) -> float:
    """Return the time in which bare PDMS plates absorb half of a cavity's excess air [s].

    A half-space takes up S sqrt(4 D t / pi) of the concentration at its surface.
    """
    depth_m = 0.5 * 1e-6 * gap_um / (2.0 * PDMS_SOLUBILITY)
    return float(np.pi * depth_m**2 / (4.0 * PDMS_M2_PER_S))


def parylene_time_constant_s(gap_um: float) -> float:
    """Return the time constant of a cavity behind an intact parylene wall, by permeation [s]."""
    held_per_pa = 1e-6 * gap_um / 101325.0 * 273.15 / ROOM_TEMPERATURE_K
    return held_per_pa * PARYLENE_M / PARYLENE_PERMEABILITY


def channel_time_constant_s(gap_um: float, electrode_mm: float, bar_mm: float) -> float:
    """Return the time constant of a cavity with a channel as high as the gap, by viscous flow [s]."""
    height_m, length_m = 1e-6 * gap_um, 1e-3 * bar_mm
    per_pa = 1e-3 * VENT_CHANNEL_WIDTH_MM * height_m**3 / (12.0 * AIR_VISCOSITY_PA_S * length_m)
    return 1e-6 * electrode_mm**2 * height_m / (1e3 * AMBIENT_KPA * per_pa)
