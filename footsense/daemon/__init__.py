"""Composition of the daemon: chooses and opens the implementation behind each interface of `ports`.

foot_types        foot type     -> files          network, response table
models            configuration -> models         network, and calibrations of the feet on the legs
acquisition       buses         -> frames         real adapters, or those of a simulated robot
estimation        models        -> pipeline
can_output        configuration -> CAN sink
recording_header  a run         -> header         and back, for a replay
service           all of it, opened in order and closed in reverse
"""
