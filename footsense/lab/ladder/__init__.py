"""One question, four answers: what a load does to the gaps, from a formula on paper to finite strain.

half_space   a formula: point force on a half-space, a lattice of bars, statics
rungs        the interface that all share, and the ones that stand on the response table or the full solve
compare      what each costs and how far it is from the finest
query        one load, one rung, as the command line shows it
"""
