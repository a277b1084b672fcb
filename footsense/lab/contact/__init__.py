"""Finite-strain contact model: a foot on a rigid floor with Coulomb friction, with contact in the sensing gaps.

    load_case    one foot, one contact, one force, and the quantities that need no solve
    mesh         the two bodies, refined under the floor and at the edges of the spacer's bars
    body         the weak form: solids, bars, cavities, floor
    floor        the interface of plane_floor (a rigid plane with Coulomb friction) and hertz_floor (a given patch)
    equilibrium  Newton's method for displacement, pressure and position of the floor together
    element_closures  closures and capacitances from the displacement
    full_solve   a load case from end to end

The most expensive fidelity level: it measures the errors of the cheaper ones.
"""
