"""The full solve: the foot at finite strain, pressed by a rigid floor with friction, its gaps closing one by one.

    mesh       the two bodies, refined where they are touched and at the edges of the spacer's bars
    material   neo-Hookean rubber with a pressure of its own, neo-Hookean PDMS, and both at small strain
    case       one foot, one contact, one force, and what follows without a solve
    floor      what presses: a rigid plane with Coulomb friction (plane), or the patch that others assume (hertz)
    body       the weak form: solids, bars, cavities, floor
    newton     one equilibrium: displacement, pressure and place of the floor together
    readout    closures and capacitances from the displacement
    foot       a load case from end to end

The dear end of the ladder of models: it tells what the cheaper ones lose.
"""
