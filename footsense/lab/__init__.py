"""Offline tools: finite element model of a foot, network training, studies. Needs the extra `lab`.

geometry, foot_file    a foot type as numbers, from its foot.yaml
fem, response          adjoint solves of the elastic foot, and the response table of them (foot/response_table.py)
walkers                robots in MuJoCo that walk on the feet
training, evaluation   load cases, networks and their export; errors, ranges, Cramer-Rao bound
build                  all files of a foot type in one run
studies, report        pages with tables and figures
"""
