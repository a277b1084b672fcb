"""Live ROS 2 messages of the legs received from CAN, published by DDS.

A topic `/a` of ROS 2 is `rt/a` in DDS, and a type `p/msg/T` is `p::msg::dds_::T_`; since Iron a writer names the hash
of its type, and rmw warns of one that does not.

Source:
    https://design.ros2.org/articles/topic_and_service_names.html; REP 2016 for the hashes.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.interfaces import Nodetype

from footsense.client.listener import LegSnapshot
from footsense.errors import FootsenseError
from footsense.ros2.messages import STORE, LegSample

if TYPE_CHECKING:
    from footsense.client import LegEvent

#: Period of the contact states [ns]: that of `Ground` on CAN.
_CONTACT_PERIOD_NS = 100_000_000


class LiveSamples:
    """Turns the values received from CAN into samples of the legs; knows which of them are new."""

    def __init__(self) -> None:
        self._n_frames: dict[str, int] = {}
        self._events: dict[str, LegEvent | None] = {}
        self._contact_ns = -math.inf

    def samples(self, snapshots: Sequence[LegSnapshot], wall_ns: int, now_ns: int) -> list[LegSample]:
        """Return a sample of each leg.

        Args:
            snapshots: The legs.
            wall_ns: The present time, since 1970 [ns].
            now_ns: The present time on a clock that does not step [ns].
        """
        contacts_due = now_ns - self._contact_ns >= _CONTACT_PERIOD_NS
        if contacts_due:
            self._contact_ns = now_ns
        samples = []
        for snapshot in snapshots:
            leg, event, n_frames = snapshot.leg, snapshot.event, snapshot.n_force_frames
            is_new_force = n_frames != self._n_frames.get(leg)
            is_new_contact = contacts_due or event is not self._events.get(leg)
            self._n_frames[leg], self._events[leg] = n_frames, event
            sample = _live_sample(snapshot, wall_ns)
            samples.append(sample._replace(is_new_force=is_new_force, is_new_contact=is_new_contact))
        return samples


def _live_sample(snapshot: LegSnapshot, wall_ns: int) -> LegSample:
    leg, force, report = snapshot.leg, snapshot.force, snapshot.report
    if not snapshot.is_current:
        return LegSample(leg)
    sample = LegSample(
        leg,
        state=force.state,
        cause=report.fault.cause if report.fault and report.fault.state is force.state else None,
        force_n=force.force_n,
        sigma_n=force.sigma_n,
        fault_mask=force.fault_mask,
        contact=force.contact,
        contact_probability=force.contact_probability,
        holds=force.holds,
        baseline_status=report.baseline.status if report.baseline else None,
    )
    if force.usable and force.age_ns is not None:
        sample = sample._replace(t_wall_ns=wall_ns - force.age_ns, age_ms=force.age_ns * 1e-6)
    if report.ground is not None:
        sample = sample._replace(
            ground_normal=report.ground.normal, friction_coefficient=report.ground.friction
        )
    return sample


class Participant:
    """DDS participant with one publisher per topic.

    Args:
        domain: The domain, 0 to 232; nodes hear each other if their ROS_DOMAIN_ID is equal.
        topics: Type of the messages of each topic.

    Raises:
        FootsenseError: There is no network to publish on.
    """

    def __init__(self, domain: int, topics: Mapping[str, str]) -> None:
        try:
            self._participant = DomainParticipant(domain)
            self._writers = {topic: self._topic_writer(topic, kind) for topic, kind in topics.items()}
        except DDSException as error:
            raise FootsenseError(f"no DDS in domain {domain}: {error}; see CYCLONEDDS_URI") from None

    def _topic_writer(self, topic: str, kind: str) -> Any:  # noqa: ANN401 - the library is not typed
        qos = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)),
            Policy.Durability.Volatile,
            Policy.History.KeepLast(10),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            Policy.Userdata(f"typehash={STORE.hash_rihs01(kind)};".encode()),
        )
        return DataWriter(self._participant, Topic(self._participant, f"rt{topic}", _dds_type(kind)), qos=qos)

    def publish(self, topic: str, cdr: bytes) -> None:
        """Publish a ROS 2 message, given as CDR bytes with their header, on a topic.

        Raises:
            FootsenseError: It cannot be sent.
        """
        writer = self._writers[topic]
        # The library asks a value of its type for its bytes; ours are there already.
        value = object.__new__(writer.data_type)
        value.serialize = lambda **_: cdr
        try:
            writer.write(value)
        except DDSException as error:
            raise FootsenseError(f"{topic}: not published: {error}") from None


@cache
def _dds_type(kind: str) -> Any:  # noqa: ANN401 - a class of the library, which is not typed
    """Return the DDS type of a ROS 2 type, which tells subscribers its fields."""
    annotations = {name: _dds_field(description) for name, description in STORE.fielddefs[kind][1]}
    package, _, name = kind.partition("/msg/")
    return make_idl_struct(f"{name}_", f"{package}.msg.dds_.{name}_", annotations)


def _dds_field(description: Any) -> Any:  # noqa: ANN401 - as above
    node, value = description
    if node is Nodetype.NAME:
        return _dds_type(value)
    if node is Nodetype.SEQUENCE:
        return types.sequence[_dds_field(value[0])]
    return str if value[0] == "string" else getattr(types, value[0])
