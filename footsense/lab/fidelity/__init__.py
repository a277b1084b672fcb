"""Four models of the foot with increasing fidelity, from a closed formula to finite strain.

half_space   a formula: point force on a half-space, statics
lattice      the closure of cavities between bars, for the formula
levels       the models by name, as functions of contact normal and force, and the command `response`
loads        the loads on which the models are compared
compare      time of each level, and its difference from the finest
forward      time of one solve per load, beside the table
drawing      figures of both
"""
