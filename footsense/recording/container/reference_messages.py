"""Samples of a test stand's force sensor as JSON, one message each, so that they can be plotted beside the scans."""

import json
from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np

from footsense.frames import Reference
from footsense.recording.container.messages import dump

_FORCE_KEYS = ("fx_n", "fy_n", "fz_n")


class _Sample(msgspec.Struct):
    t_ns: Annotated[int, msgspec.Meta(ge=-(1 << 63), le=(1 << 63) - 1)]
    fx_n: float | None
    fy_n: float | None
    fz_n: float | None
    saturated: bool


def encode_reference(reference: Reference) -> list[tuple[int, bytes]]:
    """Return each sample of a test stand's force sensor as a JSON object, with its time [ns]."""
    rows = zip(reference.t_ns.tolist(), reference.force_n.tolist(), reference.saturated.tolist(), strict=True)
    return [
        (t_ns, dump({"t_ns": t_ns, **dict(zip(_FORCE_KEYS, force_n, strict=True)), "saturated": saturated}))
        for t_ns, force_n, saturated in rows
    ]


def decode_reference(samples: Sequence[bytes]) -> Reference:
    """Return the samples that `encode_reference` wrote."""
    rows = msgspec.convert([json.loads(sample) for sample in samples], list[_Sample])
    return Reference(
        np.array([row.t_ns for row in rows], np.int64),
        np.array([[row.fx_n, row.fy_n, row.fz_n] for row in rows], np.float64).reshape(-1, 3),
        np.array([row.saturated for row in rows], np.bool_),
    )


def reference_schema() -> bytes:
    """Return the JSON schema of a sample."""
    properties = {
        "t_ns": {"type": "integer"},
        **{key: {"type": ["number", "null"]} for key in _FORCE_KEYS},
        "saturated": {"type": "boolean"},
    }
    return json.dumps({"type": "object", "properties": properties}).encode()
