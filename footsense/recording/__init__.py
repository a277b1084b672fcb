"""Recording a walk and running it again.

    loop's process            writer's process                     later
    Recorder.observe ──pipe──▶ writer ──▶ FILE.mcap.partial ──▶ FILE.mcap ──▶ Replay, ReplaySource, compare
    (cycle_records)            (cycle_records, messages, mcap_writer)         (mcap_reader, replay)

The loop's process imports `recorder` alone: no MCAP library, and microseconds per cycle.
"""
