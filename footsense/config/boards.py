"""Conversion rates and I2C addresses of the boards, as needed to check a configuration."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from firmware_interface.chips import ad7746, adg715, fdc1004


class BoardFacts(NamedTuple):
    """Conversion rates and I2C addresses of one board.

    Attributes:
        rate_by_sps: Time and noise of a conversion, by conversions per second.
        chip_name_by_address: Names of the chips on a leg's segment by their 7-bit address.
    """

    rate_by_sps: Mapping[int, fdc1004.Rate | ad7746.Rate]
    chip_name_by_address: Mapping[int, str]


BOARDS: Mapping[str, BoardFacts] = MappingProxyType(
    {
        "fdc1004": BoardFacts(fdc1004.RATES, {fdc1004.ADDRESS: "FDC1004", adg715.ADDRESS: "ADG715"}),
        "ad7746": BoardFacts(
            ad7746.RATES,
            {ad7746.ADDRESS: "AD7746", adg715.ADDRESS: "ADG715", adg715.COLUMN_ADDRESS: "second ADG715"},
        ),
    }
)
