"""Checksum appended to a network file (ONNX metadata entry).

A flipped bit in a weight gives plausible, wrong forces. Without a checksum, one in twenty of 1200 random damages to the
released file was accepted and changed a force by more than 1 mN, one in five by less.

The trailer is one more entry of the ONNX metadata, so every tool still reads the file::

    72 54                       an entry of the metadata, 84 bytes
    0a 10 "footsense_sha256"    its key
    12 40 64 hex digits         its value: SHA-256 of all before the entry
"""

import hashlib

from footsense.errors import ModelError

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
