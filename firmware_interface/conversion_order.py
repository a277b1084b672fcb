"""Order in which the elements of a foot are converted in a scan.

The order matters more than noise. While the force changes during a scan, an order that runs along the rows reads a
ramp as a tilt. In the order of the Lo-Shu magic square

    2 7 6
    9 5 1
    4 3 8        (the number is the element's position in the scan)

elements opposite each other have the same mean time, and so has every row and column: a force that grows linearly
makes no tilt at all, and the centre element stands at the frame's time. Neighbours in this order never share a
column, so that a converter with a measurement slot for each column reads from one while another converts.
"""

#: Flat indices of the elements of a foot in the order of their conversion, by the order's name.
CONVERSION_ORDERS = {
    "lo_shu": (5, 0, 7, 6, 4, 2, 1, 8, 3),
    "raster": tuple(range(9)),
}
