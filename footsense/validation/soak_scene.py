"""Robot and scene of a stretch of the soak test."""

import msgspec

from footsense.config import DEFAULT, Config
from footsense.sim.faults.scene_faults import CanTraffic
from footsense.sim.scene import Scene
from footsense.sim.scene_effects import Effects, Warming
from footsense.sim.scene_loads import Stand, Tripod
from footsense.validation.soak_plan import Stretch

#: Time at the begin in which all feet are in the air [s].
LEAD_IN_S = 1.0
#: Rare frames of another node, with the lowest priority: CAN is simulated only with traffic or faults on it.
IDLE_TRAFFIC = CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=0.1)


def robot_and_scene(stretch: Stretch, *, calm_rel: float | None = None) -> tuple[Config, Scene]:
    """Return the robot configuration of a stretch, and the simulated scene without faults.

    Args:
        stretch: The stretch.
        calm_rel: Share of the time in which the warming is over; None for all of it. A warmer foot reads too small a
            force, which no sigma covers: the walk of comparison needs the whole warming.
    """
    bitrate = 1_000_000 if stretch.publish_every == 1 else DEFAULT.can.bitrate
    config = msgspec.structs.replace(
        DEFAULT,
        scan=msgspec.structs.replace(DEFAULT.scan, rate_sps=stretch.rate_sps),
        publish_every=stretch.publish_every,
        can=msgspec.structs.replace(DEFAULT.can, bitrate=bitrate),
    )
    ten_minutes_s = 600.0 * (1.0 if calm_rel is None else calm_rel)
    scene = Scene(
        description="A robot walks for hours, with faults.",
        load=Tripod(
            period_s=stretch.gait_period_s,
            duty_rel=0.6,
            peak_force_n=0.9,
            friction_rel=0.15,
            pitch_deg=10.0,
            stands=tuple(Stand(from_s=from_s, until_s=until_s) for from_s, until_s in stretch.stands_s),
        ),
        lead_in_s=LEAD_IN_S,
        seed=stretch.seed,
        gait_table=True,
        effects=Effects(
            converter_noise=True,
            converter_clock_rel=0.01,
            gap_contact=True,
            warming=Warming(from_s=ten_minutes_s, over_s=ten_minutes_s, kelvin=stretch.kelvin)
            if stretch.kelvin
            else None,
        ),
        faults=(IDLE_TRAFFIC,),
    )
    return config, scene
