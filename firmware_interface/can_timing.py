"""Bits of a frame on a CAN bus."""

#: Frames of a leg in a cycle: `Force` and `Quality`.
FRAMES_PER_LEG = 2


def frame_bits(n_data: int) -> int:
    """Return the maximum length of a frame with an 11-bit id, stuff bits and interframe space included [bits].

    Args:
        n_data: Bytes of data.

    Example:
        >>> frame_bits(8)
        135
    """
    return 8 * n_data + 47 + (34 + 8 * n_data - 1) // 4


#: Bits of a frame with eight bytes of data.
LONGEST_FRAME_BITS = frame_bits(8)
