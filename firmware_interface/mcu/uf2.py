"""Firmware image of an RP2040 as a file that its boot loader takes: UF2, with the checksum of the second stage.

Source:
    RP2040 data sheet, 2.8.1.3.1: CRC-32/MPEG-2 of the first 252 bytes (polynomial 0x04C11DB7, start 0xFFFFFFFF, not
    reflected) in the four bytes behind them. Microsoft, UF2 file format: blocks of 512 bytes, family 0xE48BFF56.
"""

import struct

_FLASH, _FAMILY = 0x10000000, 0xE48BFF56
_SECOND_STAGE_BYTES, _PAYLOAD_BYTES = 252, 256
_BLOCK = struct.Struct("<8I476sI")
_FIRST, _SECOND, _LAST, _HAS_FAMILY = 0x0A324655, 0x9E5D5157, 0x0AB16F30, 0x2000


def crc32_mpeg2(data: bytes) -> int:
    """Return the checksum of a second stage.

    Example:
        >>> hex(crc32_mpeg2(b"123456789"))
        '0x376e6e7'
    """
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


def uf2(image: bytes) -> bytes:
    """Return a UF2 file of a flash image whose second stage has no checksum yet."""
    stage, rest = image[:_SECOND_STAGE_BYTES], image[_SECOND_STAGE_BYTES + 4 :]
    image = stage + crc32_mpeg2(stage).to_bytes(4, "little") + rest
    pieces = [image[at : at + _PAYLOAD_BYTES] for at in range(0, len(image), _PAYLOAD_BYTES)]
    return b"".join(
        _BLOCK.pack(
            *(
                _FIRST,
                _SECOND,
                _HAS_FAMILY,
                _FLASH + _PAYLOAD_BYTES * n,
                _PAYLOAD_BYTES,
                n,
                len(pieces),
                _FAMILY,
            ),
            piece,
            _LAST,
        )
        for n, piece in enumerate(pieces)
    )
