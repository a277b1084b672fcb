"""The card in a network's ONNX file: capacitor design, signals and units, training range; and the checksum behind it.

A flipped bit in a weight gives plausible, wrong forces. Without a checksum, one in twenty of 1200 random damages to the
released file was accepted and changed a force by more than 1 mN, one in five by less.

The checksum is one more entry of the ONNX metadata, so every tool still reads the file::

    72 54                       an entry of the metadata, 84 bytes
    0a 10 "footsense_sha256"    its key
    12 40 64 hex digits         its value: SHA-256 of all before the entry
"""

import hashlib
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from footsense.errors import ModelError
from footsense.foot.capacitor import GAP_CLOSED_THRESHOLD_REL, Capacitor
from footsense.frames import ELEMENTS, Vector

#: Key of the card in the file's metadata.
METADATA_KEY = "footsense_card"
FORMAT = 3
#: File of a foot type's network.
NETWORK_FILE = "network.onnx"

_CONTACT_ORDER_TEXT = "contact point x y, stereographic, then tangential over normal force x y, foot frame"


class Signal(msgspec.Struct, frozen=True):
    """Name, width, unit and component order of one input or output of the network.

    Attributes:
        name: Name in the graph.
        width: Numbers in a row.
        unit: Unit of the numbers.
        order: What they are, in their order.
    """

    name: str
    width: int
    unit: str
    order: str

    def __str__(self) -> str:
        """Return the signal as text for error messages."""
        return f"{self.name} of width {self.width} in {self.unit!r}, {self.order!r}"


_ELEMENT_ORDER_TEXT = "flat index 3 * row + column, row 0 most forward, column 0 leftmost"
_READINGS_ORDER_TEXT = f"newest, the one before, the one before that, each by {_ELEMENT_ORDER_TEXT}"

#: Inputs and outputs, as `footsense lab build` writes them; a network with others is refused.
INPUTS = (
    Signal("closure_rel", 3 * ELEMENTS, "1", _READINGS_ORDER_TEXT),
    Signal("age_s", 3 * ELEMENTS, "s", _READINGS_ORDER_TEXT),
    Signal("missing", ELEMENTS, "1", _ELEMENT_ORDER_TEXT),
)
OUTPUTS = (
    Signal("force_n", 3, "N", "x y z, foot frame"),
    Signal("sigma_n", 3, "N", "x y z, foot frame"),
    Signal("contact", 4, "1", _CONTACT_ORDER_TEXT),
    Signal("contact_sigma", 4, "1", _CONTACT_ORDER_TEXT),
)

_OfElements = Meta(min_length=ELEMENTS, max_length=ELEMENTS)
PerElement = Annotated[list[float], _OfElements]
Positive = Annotated[float, Meta(gt=0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainedInputs:
    """Capacitor design for which a network was trained; range and second moments of its training inputs.

    Attributes:
        design: The capacitors.
        closure_rel_min: Smallest training input of each element [1], shape (elements,).
        closure_rel_max: Largest training input of each element [1], shape (elements,).
        moments: Second moments of the closures, for the imputation of missing ones, shape (elements, elements).
        max_force_n: Largest force of the training [N].
    """

    design: Capacitor
    closure_rel_min: Vector
    closure_rel_max: Vector
    moments: Vector
    max_force_n: float

    def gap_closed_threshold_over_design_gap(self, gap_um: Vector) -> Vector:
        """Return the closure over the design's gap above which a gap counts as closed [1], shape as given.

        Args:
            gap_um: Air gap of each element [um], shape (..., elements).
        """
        closed_rel: Vector = GAP_CLOSED_THRESHOLD_REL * (gap_um / self.design.gap_um)
        return closed_rel

    def max_usable_closure_rel(self, gap_um: Vector) -> Vector:
        """Return the largest closure over the gap that the network can use [1]: gap not closed, and trained."""
        return np.minimum(self.closure_rel_max, self.gap_closed_threshold_over_design_gap(gap_um))


class Format(msgspec.Struct, frozen=True):
    """Format number of a card or file, which every version has; read before the other fields."""

    format: int


class _TrainedLoads(msgspec.Struct, frozen=True):
    """Range of the training loads.

    Attributes:
        max_n: Largest force [N]; the paper's foot's if a card does not name it.
    """

    max_n: Positive = 2.0


class _Training(msgspec.Struct, frozen=True):
    """Training settings of a network that the daemon needs."""

    random_loads: _TrainedLoads = _TrainedLoads()


class Card(msgspec.Struct, frozen=True):
    """Metadata card of a network, reduced to the fields that the daemon needs.

    Those of `rows`, for a board that is gone, are refused by `scan`.
    """

    format: int
    foot_type: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    gap_um: Positive
    film_um: Positive
    film_eps_r: Positive
    electrode_area_mm2: Positive
    closure_rel_min: PerElement
    closure_rel_max: PerElement
    moments: Annotated[list[PerElement], _OfElements]
    response_sha256: str
    scan: Literal["elements"] = "elements"
    training: _Training = _Training()

    @property
    def max_trained_force_n(self) -> float:
        """Largest force in the training [N]."""
        return self.training.random_loads.max_n

    @property
    def trained_inputs(self) -> TrainedInputs:
        """Capacitor design and training range, for the pipeline."""
        return TrainedInputs(
            design=msgspec.convert(self, Capacitor, from_attributes=True),
            closure_rel_min=np.array(self.closure_rel_min),
            closure_rel_max=np.array(self.closure_rel_max),
            moments=np.array(self.moments),
            max_force_n=self.max_trained_force_n,
        )


def read_card(text: str | None, where: str) -> Card:
    """Return the metadata card of a network, parsed and checked.

    Args:
        text: The metadata entry, None if the file has none.
        where: Name of the file, for messages.

    Raises:
        ModelError: There is no card, it is unreadable, of another format, unit or order, or its values are impossible
            (JSON cannot express numbers that are not finite).
    """
    if text is None:
        raise ModelError(
            f"{where}: no {METADATA_KEY} inside; a network made by `footsense lab build` has one"
        )
    try:
        # The format first: a card of another one may lack what this one has.
        found = msgspec.json.decode(text, type=Format).format
        card = msgspec.json.decode(text, type=Card) if found == FORMAT else None
    except msgspec.DecodeError as error:
        raise ModelError(f"{where}: the card does not fit: {error}") from error
    if card is None:
        raise ModelError(f"{where}: card format {found}, this version reads format {FORMAT}")
    _check_signals(where, "inputs", card.inputs, INPUTS)
    _check_signals(where, "outputs", card.outputs, OUTPUTS)
    for element, (low, high) in enumerate(zip(card.closure_rel_min, card.closure_rel_max, strict=True)):
        if not low < high:
            raise ModelError(
                f"{where}: element {element} is trained from closure {low:g} to {high:g}; "
                "closure_rel_min has to be below closure_rel_max"
            )
    moments = np.array(card.moments)
    if not (np.array_equal(moments, moments.T) and np.linalg.eigvalsh(moments)[0] > 0.0):
        raise ModelError(f"{where}: the card's moments have to be a symmetric, positive definite matrix")
    return card


def _check_signals(where: str, kind: str, found: tuple[Signal, ...], needed: tuple[Signal, ...]) -> None:
    """Raise an error unless the inputs or outputs on a card are the expected ones.

    Raises:
        ModelError: They are others.
    """
    names = [signal.name for signal in found]
    if names != [signal.name for signal in needed]:
        wanted = ", ".join(signal.name for signal in needed)
        raise ModelError(f"{where}: its {kind} are {', '.join(names) or 'none'}; the daemon needs {wanted}")
    for signal, wanted_signal in zip(found, needed, strict=True):
        if signal != wanted_signal:
            raise ModelError(f"{where}: has {signal}, the daemon needs {wanted_signal}")


_CHECKSUM_KEY = b"footsense_sha256"
_N_HEX_DIGITS = 64
_TRAILER_HEADER = (
    bytes((0x72, 2 + len(_CHECKSUM_KEY) + 2 + _N_HEX_DIGITS, 0x0A, len(_CHECKSUM_KEY)))
    + _CHECKSUM_KEY
    + bytes((0x12, _N_HEX_DIGITS))
)


def add_checksum(content: bytes) -> bytes:
    """Return the content of an ONNX file with a checksum trailer appended.

    Args:
        content: The file without one.
    """
    return content + _TRAILER_HEADER + hashlib.sha256(content).hexdigest().encode()


def verified_sha256(content: bytes, where: str) -> str:
    """Verify the checksum trailer; return the SHA-256 of the file without it, which identifies the network.

    Args:
        content: The file.
        where: Its name, for messages.

    Raises:
        ModelError: The file has no trailer, or its checksum does not match.
    """
    start = len(content) - _N_HEX_DIGITS - len(_TRAILER_HEADER)
    if start < 0 or content[start : start + len(_TRAILER_HEADER)] != _TRAILER_HEADER:
        raise ModelError(
            f"{where}: no checksum at its end: cut short, or not made by `footsense lab build`; copy it again"
        )
    found = hashlib.sha256(content[:start]).hexdigest()
    if found.encode() != content[-_N_HEX_DIGITS:]:
        raise ModelError(f"{where}: its checksum is not that of its content: damaged; copy it again")
    return found
