"""Definitions of the ROS 2 messages: field lists, type names, and `ros2msg` text for MCAP files."""

from dataclasses import fields
from functools import cache
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from footsense.ros2.messages import ROS_PACKAGE_OF_TYPE

_DEFINITION_SEPARATOR = "=" * 80


class Field(NamedTuple):
    """One field of a ROS 2 message type: name and type.

    Attributes:
        name: Its name.
        is_list: Whether it holds any number of values.
        value_type: Class of a nested message; of a plain value, the ROS name of its type.
    """

    name: str
    is_list: bool
    value_type: type | str


@cache
def fields_of(message: type) -> tuple[Field, ...]:
    """Return the fields of a ROS 2 message class, in their order."""
    hints = get_type_hints(message, include_extras=True)
    return tuple(_field_from_hint(one.name, hints[one.name]) for one in fields(message))


def _field_from_hint(name: str, hint: Any) -> Field:  # noqa: ANN401 - a type
    is_list = get_origin(hint) is list
    kind = get_args(hint)[0] if is_list else hint
    return Field(name, is_list, kind if kind in ROS_PACKAGE_OF_TYPE else get_args(kind)[1])


def ros_type_name(message: type, middle: str = "/msg/") -> str:
    """Return the ROS 2 type name of a message class, such as `geometry_msgs/msg/Wrench`.

    Example:
        >>> from footsense.ros2.messages import Wrench
        >>> ros_type_name(Wrench)
        'geometry_msgs/msg/Wrench'
    """
    return f"{ROS_PACKAGE_OF_TYPE[message]}{middle}{message.__name__}"


def message_definition(message: type) -> str:
    """Return the `ros2msg` definition text of a message class and of the classes it contains.

    Example:
        >>> from footsense.ros2.messages import Header
        >>> print(message_definition(Header).replace(_DEFINITION_SEPARATOR, "==="))
        builtin_interfaces/Time stamp
        string frame_id
        ===
        MSG: builtin_interfaces/Time
        int32 sec
        uint32 nanosec
        <BLANKLINE>
    """
    parts = [_definition_lines(message)]
    parts += [
        f"{_DEFINITION_SEPARATOR}\nMSG: {ros_type_name(one, '/')}\n{_definition_lines(one)}"
        for one in nested_types(message)
    ]
    return "".join(parts)


def nested_types(message: type) -> list[type]:
    """Return the message classes that a message class contains, each once, in the order of their occurrence."""
    types_found: dict[type, None] = {}
    for field in fields_of(message):
        if isinstance(field.value_type, type):
            types_found |= dict.fromkeys([field.value_type, *nested_types(field.value_type)])
    return list(types_found)


def _definition_lines(message: type) -> str:
    return "".join(
        f"{field.value_type if isinstance(field.value_type, str) else ros_type_name(field.value_type, '/')}"
        f"{'[]' if field.is_list else ''} {field.name}\n"
        for field in fields_of(message)
    )
