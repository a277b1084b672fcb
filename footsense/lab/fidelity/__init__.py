"""One question, four answers: what a load does to the gaps, from a formula on paper to finite strain.

    answer       the interface that all share
    half_space   a formula: point force on a half-space, a lattice of bars, statics
    rungs        by name; the ones that stand on the response table or the full solve
    compare      what each costs and how far it is from the finest
    drawing      that as a figure
    query        one load, one rung, as the command line shows it

Cheap rungs are there to be doubted: each says by the next one how wrong it is.
"""
