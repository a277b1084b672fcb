from tests.unit.ros2.dds_reader import WrenchStamped as WrenchStamped
