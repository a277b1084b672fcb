"""Which foot is mounted where, and the pack that it was calibrated into."""

import logging
from collections.abc import Mapping
from pathlib import Path

from footsense.config import Config
from footsense.errors import ModelError
from footsense.foot.calibration_reader import FootPack, read_pack

__all__ = ["packs_difference", "packs_entry", "packs_of"]

_log = logging.getLogger(__name__)

#: Entry of a recording's header.
PACKS_KEY = "packs"


def packs_of(config: Config, foot_type: str) -> dict[str, FootPack]:
    """Return the pack of every leg whose foot is named; none if the configuration names no packs.

    Args:
        config: The robot.
        foot_type: Of its feet.

    Raises:
        ModelError: A pack is missing, not whole, or for another foot or foot type; or two were fitted on different
            networks, which would cost a second call of the network in every cycle.
    """
    if config.calibrations is None:
        return {}
    feet: Mapping[str, str] = dict(config.feet.items())
    found: dict[str, FootPack] = {}
    for leg in config.legs:
        foot = feet.get(leg)
        if foot is None:
            _log.warning(
                "%s: no foot is named under feet: what is mounted is taken for the designed one", leg
            )
            continue
        found[leg] = pack = read_pack(Path(config.calibrations) / foot, foot_type, foot)
        first = next(iter(found.values()))
        if pack.network_sha256 != first.network_sha256:
            raise ModelError(
                f"{pack.folder}: fitted on network {pack.network_sha256[:12]}, {first.manifest.foot} on "
                f"{first.network_sha256[:12]}; a robot has one network, calibrate one of the two again on the other's"
            )
        _log.info("%s: %s by its pack of %s, %s", leg, foot, pack.manifest.made, pack.manifest.sha256[:12])
    return found


def packs_entry(packs: Mapping[str, FootPack]) -> dict[str, str]:
    """Return what a recording's header says of the packs: the hash of each leg's."""
    return {PACKS_KEY: ",".join(f"{leg}={pack.manifest.sha256}" for leg, pack in packs.items())}


def packs_difference(header: Mapping[str, str], packs: Mapping[str, FootPack]) -> str | None:
    """Return which leg's pack is not the one that was recorded, in words; None if all are.

    Args:
        header: What the recording says of itself; without an entry it was made without packs.
        packs: Those that are here, by leg.
    """
    entries = [entry.partition("=") for entry in header.get(PACKS_KEY, "").split(",") if entry]
    then = {leg: sha256 for leg, _, sha256 in entries}
    here = {leg: pack.manifest.sha256 for leg, pack in packs.items()}
    for leg in sorted(then.keys() | here.keys()):
        if then.get(leg) != here.get(leg):
            return (
                f"{leg} was recorded with {_named(then.get(leg))}, here is {_named(here.get(leg))}; "
                "only the same packs can give the same forces, --packs says where they are"
            )
    return None


def _named(sha256: str | None) -> str:
    return "no pack" if sha256 is None else f"the pack {sha256[:12]}"
