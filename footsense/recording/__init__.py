"""Record the cycles of a walk to MCAP, and replay them.

    loop's process           writer's process                                 later
    CycleRing ──▶ ring ──▶ CycleReader, writer ──▶ FILE.mcap.partial ──▶ FILE.mcap ──▶ Replay, ReplaySource, compare
    Recorder starts, waits for, ends the writer    (messages, mcap_writer)

The loop's process imports `recorder` alone: no MCAP library.
"""
