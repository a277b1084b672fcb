"""The workshop: from rubber to the released network. Offline, needs the extra `footsense[lab]`.

    geometry > solid > adjoint > response        the foot becomes a table (foot/response_table.py reads it)
    dataset > train (network) > export           the table becomes load cases, those a network with a card
    evaluate, evaluate_models, compare, build    how good, whether the same, and all of it in one go

Not here yet: gaps that shut and carry load, finite strain, a solved contact with the floor.
"""
