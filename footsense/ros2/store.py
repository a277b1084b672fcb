"""The types of ROS 2 that are sent: their definitions, hashes and bytes.

Source:
    The interface packages of ROS 2 Humble (equal in Jazzy and Kilted), which rosbags carries; ContactState of
    https://github.com/loco-3d/whole_body_state_msgs; LowState and its parts of
    https://github.com/unitreerobotics/unitree_ros2.
"""

from typing import Final

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
SIGMA: Final = "geometry_msgs/msg/Vector3Stamped"
CONTACT: Final = "whole_body_state_msgs/msg/ContactState"
PROBABILITY: Final = "std_msgs/msg/Float64"
HEADER: Final = "std_msgs/msg/Header"
DIAGNOSTICS: Final = "diagnostic_msgs/msg/DiagnosticArray"
LOW_STATE: Final = "unitree_go/msg/LowState"

#: What ROS itself does not have; a semicolon ends a line.
_DEFINITIONS: Final = {
    CONTACT: """
        string name; uint8 type; uint8 status; geometry_msgs/Pose pose; geometry_msgs/Twist velocity;
        geometry_msgs/Wrench wrench; geometry_msgs/Vector3 surface_normal; float64 friction_coefficient
    """,
    "unitree_go/msg/IMUState": """
        float32[4] quaternion; float32[3] gyroscope; float32[3] accelerometer; float32[3] rpy; int8 temperature
    """,
    "unitree_go/msg/MotorState": """
        uint8 mode; float32 q; float32 dq; float32 ddq; float32 tau_est; float32 q_raw; float32 dq_raw; float32 ddq_raw;
        int8 temperature; uint32 lost; uint32[2] reserve
    """,
    "unitree_go/msg/BmsState": """
        uint8 version_high; uint8 version_low; uint8 status; uint8 soc; int32 current; uint16 cycle; int8[2] bq_ntc;
        int8[2] mcu_ntc; uint16[15] cell_vol
    """,
    LOW_STATE: """
        uint8[2] head; uint8 level_flag; uint8 frame_reserve; uint32[2] sn; uint32[2] version; uint16 bandwidth;
        unitree_go/IMUState imu_state; unitree_go/MotorState[20] motor_state; unitree_go/BmsState bms_state;
        int16[4] foot_force; int16[4] foot_force_est; uint32 tick; uint8[40] wireless_remote; uint8 bit_flag;
        float32 adc_reel; int8 temperature_ntc1; int8 temperature_ntc2; float32 power_v; float32 power_a;
        uint16[4] fan_frequency; uint32 reserve; uint32 crc
    """,
}

STORE: Final = get_typestore(Stores.ROS2_HUMBLE)
for _name, _definition in _DEFINITIONS.items():
    STORE.register(get_types_from_msg(_definition.replace(";", "\n"), _name))
