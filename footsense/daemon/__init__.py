"""The composition root: the only place that names the backend behind each port.

foot_types        foot type     -> files          network, response table
calibrations      configuration -> calibrations   of the feet on the legs
acquisition       buses         -> scans          real adapters, or those of a simulated robot
estimation        network card  -> pipeline
can_output        configuration -> CAN sink
recording_header  a run         -> header         and back, for a replay
service           all of it, opened in order and closed in reverse
"""
