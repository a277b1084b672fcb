"""Scaling of forces: every foot is trained in a force unit in which its full load equals the paper's foot's.

Closures depend on the force over modulus and area alone. In a unit in which its full load is 2 N a foot of any range
looks to the training like the paper's; the network's forces are multiplied by the unit at its output.
"""

from dataclasses import replace

import msgspec

from footsense.foot.response_table import FootResponse
from footsense.lab.geometry import LoadRange

#: Full load of the paper's foot [N].
PAPER_MAX_FORCE_N = 2.0


def force_unit(loads: LoadRange) -> float:
    """Return the force unit of a foot [1]: its full load over that of the paper's foot."""
    return loads.max_n / PAPER_MAX_FORCE_N


def response_in_force_unit(response: FootResponse, unit: float) -> FootResponse:
    """Return the response table for forces divided by a unit: the same closures, smaller forces.

    Args:
        response: The foot.
        unit: The unit [1]; a foot of unit 1 is returned unchanged.
    """
    return replace(
        response,
        hertz_modulus_mpa=response.hertz_modulus_mpa / unit,
        quarter_series=response.quarter_series * unit,
        quarter_compliance=response.quarter_compliance * unit,
    )


def loads_in_force_unit(loads: LoadRange, unit: float) -> LoadRange:
    """Return the load range with its forces divided by a unit."""
    return msgspec.structs.replace(loads, max_n=loads.max_n / unit)
