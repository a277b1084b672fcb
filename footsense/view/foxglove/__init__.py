"""Server side of Foxglove's WebSocket protocol for live cycles (Foxglove, Lichtblick, PlotJuggler).

    scene     forces as arrows, closures as grids, places of the feet: Foxglove's own schemas
    channels  all topics: those of `scene`, and those of a recording, each with its schema
    session   one client: its subscriptions, and what it is sent

Source:
    github.com/foxglove/ws-protocol, specification of `foxglove.websocket.v1`; `foxglove.sdk.v1` has the same messages.
"""
