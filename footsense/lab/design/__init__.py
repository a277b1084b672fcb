"""Design of a foot from what a builder knows: a robot's weight, materials, a converter board, a fabrication process.

materials   table of rubbers and sheets       boards, processes   converters; stock thicknesses and tolerances
wishes      the builder's input               shapes, solving     solved shapes, and the responses between them
candidates  all feet that could be made       closures, screen    range and error of each, vectorised
assess      a few feet, exactly               choice              Pareto front, conflicts, the nearest design
drawing     the picture                       foot_files          foot.yaml of each chosen foot
"""
