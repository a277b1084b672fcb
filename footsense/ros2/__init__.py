"""Forces as ROS 2 messages, without an installation of ROS.

    recording ──recorded_samples──┐                       ┌──bag──▶ folder that `ros2 bag play` takes
                                  ├──▶ LegSample ──▶ messages
    CAN ────────live_samples──────┘   (leg_messages)      └──participant──▶ DDS, for running ROS 2 nodes

`messages` declares the types, from which follow the text of their definitions (`definitions`), their bytes (`cdr`) and
their DDS types (`participant`). Only `participant` needs the extra `ros2`.
"""
