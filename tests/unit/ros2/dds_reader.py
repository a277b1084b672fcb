"""A second participant: reads wrenches with types written by hand, and prints the first few as JSON.

Its only argument is the domain. Shares no code with footsense.
"""

import json
import sys

from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

Time = make_idl_struct(
    "T", "builtin_interfaces.msg.dds_.Time_", {"sec": types.int32, "nanosec": types.uint32}
)
Header = make_idl_struct("H", "std_msgs.msg.dds_.Header_", {"stamp": Time, "frame_id": str})
Vector3 = make_idl_struct("V", "geometry_msgs.msg.dds_.Vector3_", dict.fromkeys("xyz", types.float64))
Wrench = make_idl_struct("W", "geometry_msgs.msg.dds_.Wrench_", {"force": Vector3, "torque": Vector3})
WrenchStamped = make_idl_struct(
    "S", "geometry_msgs.msg.dds_.WrenchStamped_", {"header": Header, "wrench": Wrench}
)


def main() -> None:
    participant = DomainParticipant(int(sys.argv[1]))
    reader = DataReader(participant, Topic(participant, "rt/footsense/lf/wrench", WrenchStamped))
    waiting = WaitSet(participant)
    waiting.attach(ReadCondition(reader, ViewState.Any | InstanceState.Alive | SampleState.NotRead))
    n_read = 0
    while n_read < 3 and waiting.wait(duration(seconds=20)):
        for message in reader.take(3 - n_read):
            n_read += 1
            stamp, force = message.header.stamp, message.wrench.force
            told = [stamp.sec, stamp.nanosec, message.header.frame_id, force.x, force.y, force.z]
            sys.stdout.write(json.dumps(told) + "\n")


if __name__ == "__main__":
    main()
