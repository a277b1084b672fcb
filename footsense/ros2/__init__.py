"""Forces as ROS 2 messages, without an installation of ROS; needs the extra `ros2`.

    recording ──┐                                     ┌──bag──▶ folder that `ros2 bag play` takes
                ├──▶ LegSample ──messages──▶ CDR ─────┤
    CAN ──live──┘                                     └──node──▶ Zenoh, for running ROS 2 nodes

rosbags has the types of ROS, their definitions and their bytes; Zenoh sends these bytes.
"""
