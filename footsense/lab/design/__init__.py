"""Design of a foot from a robot's weight, available materials, a converter board and a fabrication process.

requirements       a builder's input, and the boards
materials          table of rubbers and sheets
processes          table of the ways to make the sheet
shapes             response of any foot, from a few solved shapes
screen             all feet that could be made; closures, range and error of each, vectorised
assess             range and errors of one foot, from its table, and errors that calibration leaves
design             the most accurate of some sizes and their files, or what conflicts
"""
