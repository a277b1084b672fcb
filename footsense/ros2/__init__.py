"""Forces as ROS 2 messages, without an installation of ROS; needs the extra `ros2`.

    recording ──┐                                     ┌──bag──▶ folder that `ros2 bag play` takes
                ├──▶ LegSample ──messages──▶ CDR ─────┤
    CAN ────────┘                                     └──live──▶ DDS, for running ROS 2 nodes

rosbags has the types of ROS, their definitions and their bytes; Cyclone DDS sends these bytes.
"""

from importlib.util import find_spec

from footsense.errors import FootsenseError


def require(package: str, user: str) -> None:
    """Raise an error unless a package of the extra `ros2` is installed.

    Args:
        package: The package.
        user: What needs it.

    Raises:
        FootsenseError: It is missing.
    """
    if find_spec(package) is None:
        raise FootsenseError(
            f"{user} needs {package}: pip install 'footsense[ros2]' (on ARM see docs/ros2.md)"
        )
