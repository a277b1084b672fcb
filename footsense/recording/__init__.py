"""Record the cycles of a walk to MCAP, and replay them.

    loop's process            writer's process                     later
    Recorder.observe ──pipe──▶ writer ──▶ FILE.mcap.partial ──▶ FILE.mcap ──▶ Replay, ReplaySource, compare
    (cycle_pipe)               (cycle_records, container)                      (container, replay)

The loop's process imports `recorder` alone: no MCAP library, and microseconds per cycle.
"""
