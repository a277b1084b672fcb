"""How fault mask and standard deviations share the bits of a CAN frame: 9 mask bits for up to nine elements, else 16.

The wider mask takes its bits from the standard deviations, which are then sent in coarser steps. Sender and receiver
have the number of elements from their configuration; feet of up to nine elements share one layout.
"""

import math
from typing import NamedTuple

#: Most elements that the narrow mask holds, and that any frame does.
NARROW_ELEMENTS, MAX_ELEMENTS = 9, 16

# Rounds up, except for the rounding error of a whole number of bits.
_CEILING_OFFSET = 1 - 1e-6


class MaskLayout(NamedTuple):
    """Bit widths and resolution of the fault mask and of the standard deviations in a frame.

    Attributes:
        mask_bits: Bits of the mask.
        sigma_bits: Bits of each standard deviation; its highest code is "no value", the next one "this or more".
        sigma_step_mn: What a bit of a standard deviation stands for [mN].
    """

    mask_bits: int
    sigma_bits: int
    sigma_step_mn: int

    @property
    def no_sigma_code(self) -> int:
        """Code that stands for an unknown standard deviation."""
        return (1 << self.sigma_bits) - 1

    @property
    def all_elements_mask(self) -> int:
        """Fault mask with the bits of all elements set."""
        return (1 << self.mask_bits) - 1

    def sigma_code(self, sigma_n: float) -> int:
        """Return the code of a standard deviation [N], rounded up; NaN and negative values give "no value"."""
        if not sigma_n >= 0.0:
            return self.no_sigma_code
        return int(min(sigma_n * 1000 / self.sigma_step_mn + _CEILING_OFFSET, self.no_sigma_code - 1))

    def sigma_n(self, code: int) -> float:
        """Return the standard deviation of a code [N]; NaN for "no value"."""
        return math.nan if code == self.no_sigma_code else code * self.sigma_step_mn / 1000


#: Layouts of a frame for the narrow mask and for the wide one: of `Quality`, and of a leg in `Forces`.
QUALITY_LAYOUTS = MaskLayout(9, 9, 2), MaskLayout(16, 6, 16)
FORCES_LAYOUTS = MaskLayout(9, 8, 4), MaskLayout(16, 5, 32)


def mask_layout(layouts: tuple[MaskLayout, MaskLayout], n_elements: int) -> MaskLayout:
    """Return the first of two layouts whose mask has room for `n_elements` elements.

    Args:
        layouts: `QUALITY_LAYOUTS` or `FORCES_LAYOUTS`.
        n_elements: Elements of each foot of the robot, 1..16.

    Raises:
        ValueError: A frame holds no mask of so many elements.

    Example:
        >>> mask_layout(QUALITY_LAYOUTS, 4).mask_bits, mask_layout(QUALITY_LAYOUTS, 16).mask_bits
        (9, 16)
    """
    if not 1 <= n_elements <= MAX_ELEMENTS:
        raise ValueError(f"{n_elements} elements: the frames hold the masks of 1 to {MAX_ELEMENTS}")
    return layouts[n_elements > NARROW_ELEMENTS]
