"""JSON messages of a recording: topics, encoders, checked decoders, and JSON schemas.

A float is written with the fewest digits that give the same 64 bits back; NaN is null, and infinity, for which JSON has
no word, is the number 1e999. Each sample of a reference and each event of the gait is a message of its own, so that
they can be plotted.

The readings of all elements are written with every conversion, of which one is new: the container's compression finds
repetitions, and writing the changes alone would save a tenth of the file.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from operator import attrgetter
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.frames import (
    ELEMENTS,
    CapFrame,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Cycle,
    CycleField,
    GaitEvent,
    GaitEventKind,
    GaitFrame,
    LegMotion,
    ReferenceSamples,
    Result,
)
from footsense.ring.records import (
    CYCLE_FIELDS,
    GAIT_FIELDS,
    MOTION_FIELDS,
    NonNegativeInt64,
    frame_from_arrays,
)

SCAN, FORCE, EVENT, REFERENCE = "/scan", "/force", "/event", "/reference"
GAIT, GAIT_EVENT, MOTION = "/gait", "/gait_event", "/motion"

SCAN_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("scan.")}
FORCE_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("forces.")}
_AXES = ("fx_n", "fy_n", "fz_n")

#: Time on the clock of a run [ns], of which a sum with the time since 1970 has 64 bits: within 36 years.
_SentTime = Annotated[int, msgspec.Meta(ge=0, le=1 << 60)]
_Int64 = Annotated[int, msgspec.Meta(ge=-(1 << 63), le=(1 << 63) - 1)]
#: Time [ns] and bytes of a message.
TimedMessage = tuple[int, bytes]


def _numbers(t_ns: int, message: Mapping[str, Any]) -> TimedMessage:
    """Return a message without free text, in which NaN and infinity could be hit."""
    text = json.dumps(message, separators=(",", ":")).replace("NaN", "null").replace("Infinity", "1e999")
    return t_ns, text.encode()


def leg_objects(frame: Any, legs: Sequence[str], fields: Mapping[str, CycleField]) -> dict[str, Any]:  # noqa: ANN401 - frames of three kinds
    """Return the values of each leg in a frame by field key."""
    objects: dict[str, dict[str, Any]] = {leg: {} for leg in legs}
    for path, field in fields.items():
        column = attrgetter(path.partition(".")[2])(frame).astype(field.dtype, copy=False).tolist()
        if field.code_enum is not None:
            column = [field.code_enum(code).name for code in column]
        for entries, value in zip(objects.values(), column, strict=True):
            entries.update(zip(field.json_keys, value if len(field.json_keys) > 1 else [value], strict=True))
    return objects


def _events(cycle: Cycle, legs: Sequence[str]) -> Iterator[TimedMessage]:
    def of(command: Command) -> dict[str, str]:
        return {"command": command.kind.name, "leg": legs[command.leg]}

    events: list[dict[str, object]] = [
        {"event": "command", **of(command)} for command in cycle.started_commands
    ]
    events += [
        {"event": "outcome", **of(outcome.command), "result": outcome.result.name, "reason": outcome.reason}
        for outcome in cycle.ended_commands
    ]
    if cycle.temperature_c is not None:
        known_c = [None if np.isnan(value) else value for value in cycle.temperature_c.tolist()]
        events.append({"event": "temperature", "temperature_c": dict(zip(legs, known_c, strict=True))})
    return ((cycle.forces.t_sent_ns, json.dumps(event).encode()) for event in events)


def _reference(cycle: Cycle, _: Sequence[str]) -> Iterator[TimedMessage]:
    if cycle.reference is not None:
        columns = (column.tolist() for column in cycle.reference)
        for t_ns, force_n, saturated in zip(*columns, strict=True):
            sample = {"t_ns": t_ns, **dict(zip(_AXES, force_n, strict=True)), "saturated": saturated}
            yield _numbers(t_ns, sample)


def _gait(cycle: Cycle, legs: Sequence[str]) -> Iterator[TimedMessage]:
    if (gait := cycle.forces.gait) is not None:
        whole = {"t_ns": gait.t_ns, "friction": gait.friction, "all_in_air": gait.all_in_air}
        yield _numbers(cycle.forces.t_sent_ns, {**whole, **leg_objects(gait, legs, GAIT_FIELDS)})


def _gait_events(cycle: Cycle, legs: Sequence[str]) -> Iterator[TimedMessage]:
    for event in cycle.forces.gait.events if cycle.forces.gait is not None else ():
        names = {"kind": GaitEventKind(event.kind).name, "leg": legs[event.leg]}
        yield _numbers(cycle.forces.t_sent_ns, {**names, "t_ns": event.t_ns, "sigma_s": event.sigma_s})


def _motion(cycle: Cycle, legs: Sequence[str]) -> Iterator[TimedMessage]:
    if cycle.motion is not None:
        yield _numbers(cycle.forces.t_sent_ns, leg_objects(cycle.motion, legs, MOTION_FIELDS))


def _scan(cycle: Cycle, legs: Sequence[str]) -> Iterator[TimedMessage]:
    rows = leg_objects(cycle.scan, legs, SCAN_FIELDS)
    yield _numbers(cycle.forces.t_sent_ns, {"sequence": cycle.scan.sequence, **rows})


def _force(cycle: Cycle, legs: Sequence[str]) -> Iterator[TimedMessage]:
    forces = cycle.forces
    rows = leg_objects(forces, legs, FORCE_FIELDS)
    yield _numbers(forces.t_sent_ns, {"sequence": forces.sequence, "t_sent_ns": forces.t_sent_ns, **rows})


#: Encoder of each topic's messages of a cycle, in the order of the file: who has read the force has the whole cycle.
ENCODERS: dict[str, Callable[[Cycle, Sequence[str]], Iterator[TimedMessage]]] = {
    EVENT: _events,
    REFERENCE: _reference,
    GAIT: _gait,
    GAIT_EVENT: _gait_events,
    MOTION: _motion,
    SCAN: _scan,
    FORCE: _force,
}


def loss_event(n_cycles: int) -> bytes:
    """Return the message that `n_cycles` cycles were lost because the recorder was too slow."""
    return json.dumps({"event": "loss", "n_cycles": n_cycles}).encode()


def decode_loss(event: bytes) -> int | None:
    """Return the number of lost cycles in an event; None if it is another one."""
    message = json.loads(event)
    if message.get("event") != "loss":
        return None
    return msgspec.convert(message["n_cycles"], NonNegativeInt64)


def decode_cycle(parts: defaultdict[str, list[bytes]], legs: Sequence[str], *, has_reference: bool) -> Cycle:
    """Return the cycle in its messages, by topic.

    Raises:
        MsgspecError: An entry is no such number.
        LookupError: An entry is missing, or no such name.
        ValueError: There are not so many entries or messages.
    """
    scan, force = (_only(parts[topic]) for topic in (SCAN, FORCE))
    sequences = (msgspec.convert(message["sequence"], NonNegativeInt64) for message in (scan, force))
    scan_sequence, force_sequence = sequences
    t_sent_ns = msgspec.convert(force["t_sent_ns"], _SentTime)
    arrays = _arrays(force, legs, FORCE_FIELDS)
    forces = frame_from_arrays(ContactFrame, arrays, sequence=force_sequence, t_sent_ns=t_sent_ns)
    if parts[GAIT]:
        forces = forces._replace(gait=_decode_gait(_only(parts[GAIT]), parts[GAIT_EVENT], legs))
    commands, outcomes, temperature_c = [], [], None
    for event in map(json.loads, parts[EVENT]):
        match event["event"]:
            case "command":
                commands.append(_command(event, legs))
            case "outcome":
                reason = msgspec.convert(event["reason"], str)
                outcomes.append(CommandResult(_command(event, legs), Result[event["result"]], reason))
            case "temperature":
                values = [event["temperature_c"][leg] for leg in legs]
                temperature_c = np.array(msgspec.convert(values, list[float | None]), np.float64)
    return Cycle(
        frame_from_arrays(CapFrame, _arrays(scan, legs, SCAN_FIELDS), sequence=scan_sequence),
        tuple(commands),
        forces,
        tuple(outcomes),
        _decode_reference(parts[REFERENCE]) if has_reference else None,
        temperature_c,
        frame_from_arrays(LegMotion, _arrays(_only(parts[MOTION]), legs, MOTION_FIELDS))
        if parts[MOTION]
        else None,
    )


def _only(found: Sequence[bytes]) -> dict[str, Any]:
    if len(found) != 1:
        raise ValueError(f"{len(found)} messages of a topic that has one in each cycle")
    message: dict[str, Any] = json.loads(found[0])
    return message


def _command(event: Mapping[str, Any], legs: Sequence[str]) -> Command:
    return Command(CommandKind[event["command"]], legs.index(event["leg"]))


class _ReferenceSample(msgspec.Struct):
    t_ns: _Int64
    fx_n: float | None
    fy_n: float | None
    fz_n: float | None
    saturated: bool


def _decode_reference(samples: Sequence[bytes]) -> ReferenceSamples:
    rows = msgspec.convert([json.loads(sample) for sample in samples], list[_ReferenceSample])
    return ReferenceSamples(
        np.array([row.t_ns for row in rows], np.int64),
        np.array([[row.fx_n, row.fy_n, row.fz_n] for row in rows], np.float64).reshape(-1, 3),
        np.array([row.saturated for row in rows], np.bool_),
    )


class _GaitMessage(msgspec.Struct):
    t_ns: NonNegativeInt64
    friction: float | None
    all_in_air: bool


class _GaitEventMessage(msgspec.Struct):
    kind: str
    leg: str
    t_ns: _Int64
    sigma_s: float


def _decode_gait(message: dict[str, Any], events: Sequence[bytes], legs: Sequence[str]) -> GaitFrame:
    whole = msgspec.convert(message, _GaitMessage)
    read = msgspec.convert([json.loads(event) for event in events], list[_GaitEventMessage])
    found = tuple(
        GaitEvent(GaitEventKind[event.kind], legs.index(event.leg), event.t_ns, event.sigma_s)
        for event in read
    )
    return frame_from_arrays(
        GaitFrame,
        _arrays(message, legs, GAIT_FIELDS),
        t_ns=whole.t_ns,
        friction=float("nan") if whole.friction is None else whole.friction,
        all_in_air=whole.all_in_air,
        events=found,
    )


def _arrays(
    message: Mapping[str, Any], legs: Sequence[str], fields: Mapping[str, CycleField]
) -> dict[str, NDArray[Any]]:
    """Return the fields of all legs as arrays; null, and a number that older recordings do not have, become NaN."""
    rows = [message[leg] for leg in legs]
    arrays = {}
    for path, field in fields.items():
        is_number = field.dtype == "<f8"
        values = [[row.get(key) if is_number else row[key] for key in field.json_keys] for row in rows]
        if field.code_enum is not None:
            arrays[path] = np.array([field.code_enum[name] for (name,) in values], field.dtype)
        else:
            checked = msgspec.convert(values, _json_rows_type(field))
            arrays[path] = np.array(checked, field.dtype).reshape(len(rows), *field.row_shape)
    return arrays


@cache
def _json_rows_type(field: CycleField) -> Any:  # noqa: ANN401 - a type
    """Return the Python type that a field must have in decoded JSON, for validation."""
    entry: Any = float | None
    if field.max_code is not None:
        entry = Annotated[int, msgspec.Meta(ge=0, le=int(field.max_code))]
    elif field.dtype == "<i8":
        entry = int
    if field.row_shape and len(field.json_keys) == 1:
        entry = list[entry]
    return list[list[entry]]


def topic_schemas(legs: Sequence[str]) -> dict[str, bytes]:
    """Return the JSON schema of each topic; `/reference` is in the recordings of a test stand alone."""
    number, whole, text = {"type": ["number", "null"]}, {"type": "integer"}, {"type": "string"}
    boolean = {"type": "boolean"}

    def object_of(**properties: Any) -> dict[str, Any]:  # noqa: ANN401 - a JSON schema is any JSON
        return {"type": "object", "properties": properties}

    def rows(fields: Mapping[str, CycleField]) -> dict[str, Any]:
        properties: dict[str, Any] = {}
        for field in fields.values():
            value: dict[str, Any] = text if field.code_enum else number if field.dtype == "<f8" else whole
            if field.row_shape and len(field.json_keys) == 1:
                value = {"type": "array", "items": value, "minItems": ELEMENTS, "maxItems": ELEMENTS}
            properties |= dict.fromkeys(field.json_keys, value)
        return dict.fromkeys(legs, object_of(**properties))

    words = dict.fromkeys(("event", "command", "leg", "result", "reason"), text)
    topics = {
        SCAN: object_of(sequence=whole, **rows(SCAN_FIELDS)),
        FORCE: object_of(sequence=whole, t_sent_ns=whole, **rows(FORCE_FIELDS)),
        GAIT: object_of(t_ns=whole, friction=number, all_in_air=boolean, **rows(GAIT_FIELDS)),
        MOTION: object_of(**rows(MOTION_FIELDS)),
        GAIT_EVENT: object_of(kind=text, leg=text, t_ns=whole, sigma_s=number),
        EVENT: object_of(**words, n_cycles=whole, temperature_c=object_of(**dict.fromkeys(legs, number))),
        REFERENCE: object_of(t_ns=whole, **dict.fromkeys(_AXES, number), saturated=boolean),
    }
    return {topic: json.dumps(schema).encode() for topic, schema in topics.items()}
