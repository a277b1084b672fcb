"""One equilibrium: displacement, pressure and position of the floor together, by Newton's method.

With r(u, q) the nodal forces out of balance, and E_k the translation of the ground side along axis k, the floor
exerts F_k = -E_k . c(u, q), where c is the floor's part of r. It depends on u - q alone, so with its tangent C

    (  K    -C E  ) (du)   ( -r  )
    ( -E'C  E'C E ) (dq) = (f - F),

whose Schur complement needs one factorisation of K and one back-substitution per axis and one more.
"""

import math
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from footsense.lab.contact.body import Body
from footsense.lab.contact.floor import Floor

#: Most Newton steps of one load step; a sound one needs about six.
MOST_STEPS = 20


class ConvergenceError(ArithmeticError):
    """No equilibrium was found; the message names load and residual."""


@dataclass(frozen=True, slots=True)
class Balance:
    """Convergence of an equilibrium: Newton steps and residual.

    Attributes:
        steps: Newton steps, each one factorisation.
        residual_rel: Norm of the nodal forces out of balance (and of the pressure's equations, 1 mm3 as 1 N) and of
            the missing force of the floor, over the scale [1].
    """

    steps: int
    residual_rel: float


class Equilibrium:
    """The equations of a foot on a floor.

    Args:
        body: The foot; its state is the unknown.
        form: Weak form of the foot with the ground contact.
        floor: The floor; its place is the other unknown.
        scale_n: Force that residuals are divided by [N].
    """

    def __init__(self, body: Body, form: Any, floor: Floor, scale_n: float) -> None:
        self._body, self._form, self._floor, self._scale_n = body, form, floor, scale_n
        self._floor_form = body.floor_form(floor)
        self._translations = [body.translation(axis) for axis in floor.axes]
        self._free = body.space.FreeDofs()
        self._held = ~np.array(list(self._free), dtype=bool)
        self._inverse: Any = None

    @property
    def n_unknowns(self) -> int:
        """Unknowns that are free."""
        return int(self._free.NumSet())

    def _out_of_balance(self) -> tuple[Any, Any]:
        """Return the residual r, zero at fixed nodes, and the missing ground force [N], shape (axes,)."""
        vector = self._body.state.vec
        residual, pushing = vector.CreateVector(), vector.CreateVector()
        self._form.Apply(vector, residual)
        residual.FV().NumPy()[self._held] = 0.0
        self._floor_form.Apply(vector, pushing)
        exerted = [-ng.InnerProduct(translation, pushing) for translation in self._translations]
        return residual, self._floor.target_n - np.array(exerted)

    def _factorise(self) -> None:
        """Factorise the tangent at the present state."""
        self._form.AssembleLinearization(self._body.state.vec)
        self._floor_form.AssembleLinearization(self._body.state.vec)
        if self._inverse is None:
            self._inverse = self._form.mat.Inverse(self._free, "sparsecholesky")
        else:
            self._inverse.Update()

    def _step(self, residual: Any, missing_n: NDArray[np.float64]) -> None:
        """Move state and floor by one Newton step."""
        self._factorise()
        step = (self._inverse * residual).Evaluate()
        pushes = [(self._floor_form.mat * translation).Evaluate() for translation in self._translations]
        answers = [(self._inverse * push).Evaluate() for push in pushes]
        pairs = list(zip(self._translations, answers, strict=True))
        schur = np.array(
            [
                [ng.InnerProduct(push, (translation - answer).Evaluate()) for translation, answer in pairs]
                for push in pushes
            ]
        ).reshape(len(pushes), len(pushes))
        demand = missing_n - np.array([ng.InnerProduct(push, step) for push in pushes])
        floor_mm = np.linalg.solve(schur, demand)
        self._body.state.vec.data -= step
        for answer, distance in zip(answers, floor_mm, strict=True):
            self._body.state.vec.data += float(distance) * answer
        self._floor.move(floor_mm)

    def solve(self, tolerance_rel: float) -> Balance:
        """Find the equilibrium from the present state.

        Args:
            tolerance_rel: Largest residual over the scale [1].

        Returns:
            Steps and residual.

        Raises:
            ConvergenceError: The residual is no number, or too large after MOST_STEPS.
        """
        residual_rel = math.inf
        for steps in range(MOST_STEPS + 1):
            residual, missing_n = self._out_of_balance()
            residual_rel = math.hypot(ng.Norm(residual), float(np.linalg.norm(missing_n))) / self._scale_n
            # The first residual is that of a guess: small only because the guess may not touch yet.
            if steps > 0 and residual_rel <= tolerance_rel:
                return Balance(steps, residual_rel)
            if not math.isfinite(residual_rel):
                break
            if steps < MOST_STEPS:
                self._step(residual, missing_n)
        raise ConvergenceError(
            f"residual {residual_rel:.1e} of the force, wanted {tolerance_rel:.1e}, after {steps} Newton steps"
        )
