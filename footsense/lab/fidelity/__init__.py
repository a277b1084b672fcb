"""Four models of the foot, from a formula on paper to finite strain: closures and capacitances of a load.

half_space   a formula: point force on a half-space, a lattice of bars, statics
levels       the models by name, as functions of contact normal and force, and the command `response`
compare      time of each level, and its difference from the finest
drawing      figures of both
"""
