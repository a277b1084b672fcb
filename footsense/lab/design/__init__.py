"""Design of a foot from a robot's weight, available materials, a converter board and a fabrication process.

inputs        a builder's input, and tables of materials, boards and processes
prediction    range and errors of any foot, from a few solved shapes
candidates    all feet that could be made
screen        range and error of each, vectorised
choice        Pareto front, conflicts, the nearest design
drawing       the picture
foot_files    foot.yaml of each chosen foot
"""
