"""Samples of a test stand's force sensor as JSON, one message each, so that they can be plotted beside the scans."""

import json
from collections.abc import Sequence

import numpy as np

from footsense.frames import Reference
from footsense.recording.messages import dump, floats, wholes

_FORCE_KEYS = ("fx_n", "fy_n", "fz_n")


def encode_reference(reference: Reference) -> list[tuple[int, bytes]]:
    """Return each sample of a test stand's force sensor as a JSON object, with its time [ns]."""
    rows = zip(reference.t_ns.tolist(), reference.force_n.tolist(), reference.saturated.tolist(), strict=True)
    return [
        (t_ns, dump({"t_ns": t_ns, **dict(zip(_FORCE_KEYS, force_n, strict=True)), "saturated": saturated}))
        for t_ns, force_n, saturated in rows
    ]


def decode_reference(samples: Sequence[bytes]) -> Reference:
    """Return the samples that `encode_reference` wrote.

    Raises:
        TypeError: `saturated` is neither true nor false.
    """
    rows = [json.loads(sample) for sample in samples]
    if not all(isinstance(row["saturated"], bool) for row in rows):
        raise TypeError("true or false is expected")
    shape = len(rows), 3
    return Reference(
        wholes([row["t_ns"] for row in rows], np.int64, shape[:1]),
        floats([[row[key] for key in _FORCE_KEYS] for row in rows] or np.empty(shape), shape),
        np.array([row["saturated"] for row in rows], np.bool_),
    )


def reference_schema() -> bytes:
    """Return the JSON schema of a sample."""
    properties = {
        "t_ns": {"type": "integer"},
        **{key: {"type": ["number", "null"]} for key in _FORCE_KEYS},
        "saturated": {"type": "boolean"},
    }
    return json.dumps({"type": "object", "properties": properties}).encode()
