"""Plan of the soak test: its stretches, each with other rates, gait or temperature, and their robot and scene."""

import msgspec
import numpy as np

from footsense.config import DEFAULT, Config
from footsense.sim.faults.scene_faults import CanTraffic
from footsense.sim.scene import Effects, Scene, Warming
from footsense.sim.scene_loads import Standstill, Tripod

#: Hours of a day at the full rate.
_FAST_GAIT_HOURS = 4.0
#: Stretches with a stand, and begin and end of the stand [s].
_N_STANDS, _STAND_S = 2, (1200.0, 3000.0)


class Stretch(msgspec.Struct, frozen=True, kw_only=True):
    """Part of the soak test, run by one process: seed, hours, conversion rate, standstills, temperature.

    Attributes:
        number: Index in the day.
        seed: Seed of everything random.
        hours: Duration [h].
        rate_sps: Conversions per second; at 100 the robot walks at a quarter of its pace.
        publish_every: Conversions per force on CAN.
        standstill_spans_s: Spans in which the robot stands [s].
        warming_k: Warming over ten minutes [K].
    """

    number: int = 0
    seed: int = 0
    hours: float
    rate_sps: int = 400
    publish_every: int = 4
    standstill_spans_s: tuple[tuple[float, float], ...] = ()
    warming_k: float = 0.0

    @property
    def gait_period_s(self) -> float:
        """Gait period [s], proportional to the conversion period."""
        return 1.2 * 400 / self.rate_sps


def soak_stretches(hours: float, seed: int) -> list[Stretch]:
    """Return the stretches of a soak test, each with its own rates, seed and standstills.

    A day has four hours at 400 S/s, one of them with a force on CAN for each conversion, two of them with warming and
    cooling, and the rest at 100 S/s, which takes a third of the computing time, with two stands. Up to four hours are
    three stretches: 400 S/s, the same with each force on CAN, and 100 S/s.
    """
    if hours <= _FAST_GAIT_HOURS:
        third = hours / 3.0
        plan = [
            Stretch(hours=third),
            Stretch(hours=third, publish_every=1),
            Stretch(hours=third, rate_sps=100),
        ]
    else:
        plan = [Stretch(hours=1.0, publish_every=1)]
        plan += [Stretch(hours=1.0, warming_k=kelvin) for kelvin in (0.0, 20.0, -20.0)]
        for number, begun in enumerate(np.arange(_FAST_GAIT_HOURS, hours, 2.0).tolist()):
            length = min(2.0, hours - begun)
            stands = number < _N_STANDS and length * 3600.0 > _STAND_S[1] + 600.0
            plan.append(Stretch(hours=length, rate_sps=100, standstill_spans_s=(_STAND_S,) if stands else ()))
    return [
        msgspec.structs.replace(stretch, number=number, seed=1000 * seed + number)
        for number, stretch in enumerate(plan)
    ]


#: Time at the begin in which all feet are in the air [s].
LEAD_IN_S = 1.0
#: Rare frames of another node, with the lowest priority: CAN is simulated only with traffic or faults on it.
IDLE_TRAFFIC = CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=0.1)


def robot_and_fault_free_scene(stretch: Stretch, *, warming_time_scale: float = 1.0) -> tuple[Config, Scene]:
    """Return the robot configuration and the fault-free scene of a stretch.

    Args:
        stretch: The stretch.
        warming_time_scale: Factor on start and duration of the warming, each 10 min. A warmer foot reads too small a
            force, which no sigma covers: a shorter walk of comparison needs the whole warming.
    """
    bitrate = 1_000_000 if stretch.publish_every == 1 else DEFAULT.can.bitrate
    config = msgspec.structs.replace(
        DEFAULT,
        scan=msgspec.structs.replace(DEFAULT.scan, rate_sps=stretch.rate_sps),
        publish_every=stretch.publish_every,
        can=msgspec.structs.replace(DEFAULT.can, bitrate=bitrate),
    )
    warming_s = 600.0 * warming_time_scale
    scene = Scene(
        description="A robot walks for hours, with faults.",
        load=Tripod(
            period_s=stretch.gait_period_s,
            duty_rel=0.6,
            peak_force_n=0.9,
            friction_rel=0.15,
            pitch_deg=10.0,
            stands=tuple(
                Standstill(from_s=from_s, until_s=until_s) for from_s, until_s in stretch.standstill_spans_s
            ),
        ),
        lead_in_s=LEAD_IN_S,
        seed=stretch.seed,
        gait_table=True,
        effects=Effects(
            converter_noise=True,
            converter_clock_rel=0.01,
            gap_contact=True,
            warming=Warming(from_s=warming_s, over_s=warming_s, kelvin=stretch.warming_k)
            if stretch.warming_k
            else None,
        ),
        faults=(IDLE_TRAFFIC,),
    )
    return config, scene
