"""Order in which the elements of a foot are converted in a scan.

The order matters more than noise. While the force changes during a scan, an order that runs along the rows reads a
ramp as a tilt. In the order of the Lo-Shu magic square

    2 7 6
    9 5 1
    4 3 8        (the number is the element's position in the scan)

elements opposite each other have the same mean time, and so has every row and column: a force that grows linearly
makes no tilt at all, and the centre element stands at the frame's time. Neighbours in this order never share a
column, so that a converter with a measurement slot for each column reads from one while another converts.

Four by four elements have such squares too; the one here needs as few changes of the row as any. Two by two have none:
their rows have the same mean time, and their columns differ by a conversion.
"""

from collections.abc import Mapping
from types import MappingProxyType

#: Elements in the order of a magic square, by flat index, of each number of rows.
_MAGIC_SQUARE_ORDERS: Mapping[int, tuple[int, ...]] = MappingProxyType(
    {
        2: (0, 3, 2, 1),
        3: (5, 0, 7, 6, 4, 2, 1, 8, 3),
        4: (0, 7, 13, 10, 11, 12, 6, 1, 14, 9, 3, 4, 5, 2, 8, 15),
    }
)


def conversion_order(order: str, rows: int) -> tuple[int, ...]:
    """Return the element indices of a foot in the order of their conversion.

    Args:
        order: `lo_shu` for that of a magic square, `raster` for row after row.
        rows: Rows of elements, and as many columns: 2 to 4.

    Example:
        >>> conversion_order("lo_shu", 2), conversion_order("raster", 2)
        ((0, 3, 2, 1), (0, 1, 2, 3))
    """
    return _MAGIC_SQUARE_ORDERS[rows] if order == "lo_shu" else tuple(range(rows**2))
