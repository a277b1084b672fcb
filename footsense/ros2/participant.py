"""DDS participant that publishes topics to ROS 2 nodes; needs the extra `ros2`.

A topic `/a` of ROS 2 is `rt/a` in DDS, and a type `p/msg/T` is `p::msg::dds_::T_`; since Iron a writer names the hash
of its type, and rmw warns of one that does not.

Source:
    https://design.ros2.org/articles/topic_and_service_names.html; REP 2016 for the hashes, computed from the
    definitions (a test compares them).
"""

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any

from footsense.errors import FootsenseError
from footsense.ros2.definitions import fields_of, ros_type_name
from footsense.ros2.messages import ContactState, DiagnosticArray, TFMessage, WrenchStamped
from footsense.ros2.topics import TF_STATIC, TopicMessage

try:
    from cyclonedds.core import DDSException
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import make_idl_struct, types
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    HAS_DDS = True
except ImportError:
    HAS_DDS = False

#: Hash of each published type.
TYPE_HASHES = {
    WrenchStamped: "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    ContactState: "RIHS01_1e2281fe2dc3ac425ed6743bdb4ba62dcf1b1d8b79c728bd2ac736407cc1fd23",
    DiagnosticArray: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    TFMessage: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}


@cache
def dds_type(message: type) -> Any:  # noqa: ANN401 - a class of the library, which is not typed
    """Return the DDS type of a ROS 2 message class."""
    plain = {"string": str} | {
        name: getattr(types, name) for name in ("byte", "uint8", "int32", "uint32", "float64")
    }
    annotations = {}
    for field in fields_of(message):
        kind = plain[field.value_type] if isinstance(field.value_type, str) else dds_type(field.value_type)
        annotations[field.name] = types.sequence[kind] if field.is_list else kind
    name = ros_type_name(message, ".msg.dds_.") + "_"
    return make_idl_struct(f"{message.__name__}_", name, annotations)


def dds_value(value: Any) -> Any:  # noqa: ANN401 - messages of any type
    """Return a ROS 2 message, or a value in it, as an instance of its DDS type."""
    if isinstance(value, list):
        return [dds_value(one) for one in value]
    if isinstance(value, str | int | float):
        return value
    kind: type = type(value)
    return dds_type(kind)(*(dds_value(getattr(value, field.name)) for field in fields(value)))


class Participant:
    """DDS participant with one publisher per topic.

    Args:
        domain: The domain, 0 to 232; nodes hear each other if their ROS_DOMAIN_ID is equal.
        topics: Class of the messages of each topic.

    Raises:
        FootsenseError: The extra `ros2` is not installed, or there is no network to publish on.
    """

    def __init__(self, domain: int, topics: Mapping[str, type]) -> None:
        if not HAS_DDS:
            raise FootsenseError("ROS 2 messages need cyclonedds: pip install 'footsense[ros2]'")
        try:
            self._participant = DomainParticipant(domain)
            self._writers = {topic: self._topic_writer(topic, kind) for topic, kind in topics.items()}
        except DDSException as error:
            raise FootsenseError(f"no DDS in domain {domain}: {error}; see CYCLONEDDS_URI") from None

    def _topic_writer(self, topic: str, kind: type) -> Any:  # noqa: ANN401 - the library is not typed
        is_static = topic == TF_STATIC
        qos = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)),
            Policy.Durability.TransientLocal if is_static else Policy.Durability.Volatile,
            Policy.History.KeepLast(1 if is_static else 10),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            Policy.Userdata(f"typehash={TYPE_HASHES[kind]};".encode()),
        )
        return DataWriter(self._participant, Topic(self._participant, f"rt{topic}", dds_type(kind)), qos=qos)

    def publish(self, message: TopicMessage) -> None:
        """Publish a ROS 2 message on its topic.

        Raises:
            FootsenseError: It cannot be sent.
        """
        try:
            self._writers[message.topic].write(dds_value(message.message))
        except DDSException as error:
            raise FootsenseError(f"{message.topic}: not published: {error}") from None
