"""Writer of a ROS 2 bag: a folder with an MCAP file of CDR messages and `metadata.yaml`, for `ros2 bag play`.

Version 5 of the metadata, which Humble writes and later distributions read. A bag never mixes JSON and CDR: rosbag2
takes the encoding of the first topic for that of all (ros2/rosbag2#1245).
"""

import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from footsense.errors import RecordingError
from footsense.ros2.cdr import encode
from footsense.ros2.definitions import message_definition, ros_type_name
from footsense.ros2.topics import TF_STATIC, TopicMessage, TopicMessageBuilder

#: Codes of rmw: keep the last, reliable, transient local or volatile, automatic liveliness; and its infinite time.
_KEEP_LAST, _RELIABLE, _TRANSIENT_LOCAL, _VOLATILE, _AUTOMATIC = 1, 1, 1, 2, 1
_INFINITE_DURATION = {"sec": 9223372036, "nsec": 854775807}


def qos_profile(topic: str) -> str:
    """Return the QoS profile of a topic as YAML text, as rosbag2 stores it."""
    profile = {
        "history": _KEEP_LAST,
        "depth": 1 if topic == TF_STATIC else 10,
        "reliability": _RELIABLE,
        "durability": _TRANSIENT_LOCAL if topic == TF_STATIC else _VOLATILE,
        "deadline": dict(_INFINITE_DURATION),
        "lifespan": dict(_INFINITE_DURATION),
        "liveliness": _AUTOMATIC,
        "liveliness_lease_duration": dict(_INFINITE_DURATION),
        "avoid_ros_namespace_conventions": False,
    }
    return yaml.safe_dump([profile], sort_keys=False)


class Bag:
    """ROS 2 bag that is being written; see `create_bag`."""

    def __init__(self, folder: Path, name: str, topics: TopicMessageBuilder) -> None:
        self._folder, self._file_name = folder, f"{name}_0.mcap"
        self._topics = topics
        self._n_messages: Counter[str] = Counter()
        self._span_ns: tuple[int, int] | None = None
        self._file = (folder / self._file_name).open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2")
        schemas: dict[type, int] = {}
        self._channels: dict[str, int] = {}
        for topic, kind in topics.types.items():
            if kind not in schemas:
                schemas[kind] = self._writer.register_schema(
                    ros_type_name(kind), "ros2msg", message_definition(kind).encode()
                )
            metadata = {"offered_qos_profiles": qos_profile(topic)}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schemas[kind], metadata)

    @property
    def n_messages(self) -> int:
        """Number of messages written so far."""
        return self._n_messages.total()

    def add(self, message: TopicMessage, t_ns: int) -> None:
        """Write a ROS 2 message to the bag.

        Args:
            message: The message and its topic.
            t_ns: Time of sending, since 1970 [ns]; not below that of the message before.
        """
        self._writer.add_message(
            self._channels[message.topic],
            log_time=t_ns,
            publish_time=t_ns,
            sequence=self._n_messages[message.topic],
            data=encode(message.message),
        )
        self._n_messages[message.topic] += 1
        self._span_ns = (t_ns if self._span_ns is None else self._span_ns[0], t_ns)

    def close(self) -> None:
        """Write the index of the MCAP file, and `metadata.yaml`."""
        self._writer.finish()
        self._file.close()
        text = yaml.safe_dump({"rosbag2_bagfile_information": self._metadata()}, sort_keys=False)
        (self._folder / "metadata.yaml").write_text(text, encoding="utf-8")

    def _metadata(self) -> dict[str, Any]:
        first_ns, last_ns = self._span_ns or (0, 0)
        span = {
            "duration": {"nanoseconds": last_ns - first_ns},
            "starting_time": {"nanoseconds_since_epoch": first_ns},
            "message_count": self.n_messages,
        }
        return {
            "version": 5,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic,
                        "type": ros_type_name(kind),
                        "serialization_format": "cdr",
                        "offered_qos_profiles": qos_profile(topic),
                    },
                    "message_count": self._n_messages[topic],
                }
                for topic, kind in self._topics.types.items()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._file_name],
            "files": [
                {
                    "path": self._file_name,
                    **{key: dict(value) if isinstance(value, dict) else value for key, value in span.items()},
                }
            ],
        }


@contextmanager
def create_bag(folder: Path, topics: TopicMessageBuilder) -> Iterator[Bag]:
    """Create a ROS 2 bag during a `with` block; the folder gets its name once it is complete.

    Args:
        folder: The new folder.
        topics: What it will hold.

    Yields:
        The open bag.

    Raises:
        RecordingError: The folder exists or cannot be written.
    """
    partial = folder.with_name(f"{folder.name}.partial")
    if folder.exists():
        raise RecordingError(f"{folder}: exists and is not overwritten; choose another name or remove it")
    try:
        partial.mkdir()
        bag = Bag(partial, folder.name, topics)
        yield bag
        bag.close()
        partial.rename(folder)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
