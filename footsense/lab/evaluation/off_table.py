"""A foot whose response differs smoothly from its table, as one of another rubber, mesh or assembly may."""

import numpy as np

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.lab.training.gait_windows import contact_and_normal_force

#: How fast the error changes with contact point and friction ratio [1], and seed of its shape: that of all feet.
_WAVES_PER_UNIT, _SEED = (4.0, 4.0, 3.0, 3.0), 1


class OffTableFoot(Specimen):
    """Specimen whose changes of capacitance are off the table by a wave over contact point and friction.

    Args:
        response: Response of its type.
        deviations: Its deviations.
        error_rel: Error of a change, rms over the loads [1].
    """

    def __init__(
        self, response: FootResponse, deviations: Deviations | None = None, *, error_rel: float
    ) -> None:
        super().__init__(response, deviations)
        random = np.random.default_rng(_SEED)
        self._waves = random.normal(size=(ELEMENTS, len(_WAVES_PER_UNIT))) * _WAVES_PER_UNIT
        self._phase = random.uniform(0.0, 2.0 * np.pi, ELEMENTS)
        self._amplitude_rel = np.sqrt(2.0) * error_rel

    def capacitance_pf(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the capacitance of each element under n loads [pF], shape (n, elements); see `Specimen`."""
        contact, _ = contact_and_normal_force(force_n, normal)
        off_rel = self._amplitude_rel * np.sin(contact @ self._waves.T + self._phase)
        change_pf = super().capacitance_pf(normal, force_n) - self.unloaded_pf
        capacitance_pf: Vector = self.unloaded_pf + (1.0 + off_rel) * change_pf
        return capacitance_pf
