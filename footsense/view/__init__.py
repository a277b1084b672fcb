"""Web page of a robot, and the same data by Foxglove's protocol; runs in a process beside the service.

    the loop ─ ring.cycle_reader ─────▶ live ─┐                       ┌─▶ page_session ─▶ assets/ in a browser
                                                ├─▶ signals, events ─ server
    FILE.mcap ─ recording.replay ─▶ recorded  ──┘                       └─▶ foxglove ─▶ Foxglove, PlotJuggler

Nothing here writes to the service.
"""
