"""Newton solver for displacement, pressure and floor position in static equilibrium.

The floor's position is a NumberSpace of the same compound space, so that one factorisation covers both. The loop is our
own and not `ngsolve.nonlinearsolvers.NewtonSolver`, which stops on the energy of the step: the tolerance here is a
force out of balance.
"""

import math
from typing import Any

import ngsolve as ng
import numpy as np

from footsense.lab.contact.body import Body

#: Most Newton steps of one load step; a sound one needs about six.
MAX_NEWTON_STEPS = 20


class ConvergenceError(ArithmeticError):
    """Raised when Newton's method finds no equilibrium; the message names load and residual."""


class Equilibrium:
    """Equilibrium equations of a foot on a floor, and their Newton solver.

    Args:
        body: The foot; its state is the unknown.
        weak_form: Weak form of the foot with the ground contact.
        scale_n: Force that residuals are divided by [N].
    """

    def __init__(self, body: Body, weak_form: Any, scale_n: float) -> None:
        self._body, self._form, self._scale_n = body, weak_form, scale_n
        self._free = body.space.FreeDofs()
        self._held = ~np.array(list(self._free), dtype=bool)
        self._inverse: Any = None

    @property
    def n_unknowns(self) -> int:
        """Number of free unknowns of the finite element problem."""
        return int(self._free.NumSet())

    def _residual(self) -> Any:
        """Return the unbalanced nodal forces and the error of the floor force [N], zero at fixed nodes."""
        residual = self._body.state.vec.CreateVector()
        self._form.Apply(self._body.state.vec, residual)
        residual.FV().NumPy()[self._held] = 0.0
        return residual

    def _newton_step(self, residual: Any) -> None:
        """Apply one Newton step to the displacement, pressure and floor position."""
        self._form.AssembleLinearization(self._body.state.vec)
        if self._inverse is None:
            self._inverse = self._form.mat.Inverse(self._free, "sparsecholesky")
        else:
            self._inverse.Update()
        self._body.state.vec.data -= self._inverse * residual

    def solve(self, tolerance_rel: float) -> int:
        """Iterate Newton's method from the present state until equilibrium.

        Args:
            tolerance_rel: Largest residual over the scale [1]: the norm of the nodal forces out of balance, of the
                pressure's equations (1 mm3 as 1 N) and of the missing force of the floor.

        Returns:
            Newton steps, each one factorisation.

        Raises:
            ConvergenceError: The residual is no number, or too large after MAX_NEWTON_STEPS.
        """
        residual_rel = math.inf
        for steps in range(MAX_NEWTON_STEPS + 1):
            residual = self._residual()
            residual_rel = ng.Norm(residual) / self._scale_n
            # The first residual is that of a guess: small only because the guess may not touch yet.
            if steps > 0 and residual_rel <= tolerance_rel:
                return steps
            if not math.isfinite(residual_rel):
                break
            if steps < MAX_NEWTON_STEPS:
                self._newton_step(residual)
        raise ConvergenceError(
            f"residual {residual_rel:.1e} of the force, wanted {tolerance_rel:.1e}, after {steps} Newton steps"
        )
