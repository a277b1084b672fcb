"""Send the motion of the legs to the service over CAN, with a sequence counter."""

import math
from collections.abc import Sequence

from firmware_interface.can.codes import NODE_IDS, StepPhase
from firmware_interface.can.crc8 import next_counter
from firmware_interface.can.gait import LEG_MOTION, LegMotionFrame

#: Largest acceleration of a frame [m/s2].
_MOST_M_PER_S2 = 327.67
#: Longest `up` that is a unit vector [1], by the rounding of who made it.
_MAX_LENGTH = 1.001


class Motions:
    """Encoder of the legs' motions, as a gait controller knows them.

    What the service has not heard of for 50 ms is unknown to it: send each leg's with every step of the controller.

    Example:
        >>> can_id, data = Motions().encode(1, acceleration_m_per_s2=-2.5, sigma_m_per_s2=0.5, up=(0.0, 0.6, 0.8))
        >>> hex(can_id), data.hex(" ")
        ('0x131', 'ab 00 06 ff 2e 00 60 09')
    """

    def __init__(self) -> None:
        self._counters = dict.fromkeys(NODE_IDS.values(), 0)

    def encode(
        self,
        node: int,
        *,
        acceleration_m_per_s2: float = math.nan,
        sigma_m_per_s2: float = math.nan,
        up: Sequence[float] = (math.nan, math.nan, math.nan),
        phase: StepPhase = StepPhase.UNKNOWN,
    ) -> tuple[int, bytes]:
        """Return CAN id and data of the next motion of a leg; NaN for what is not known.

        Args:
            node: CAN node id of the leg, 1..8.
            acceleration_m_per_s2: Acceleration of the foot along its z, gravity not included [m/s2], to +-327.67.
            sigma_m_per_s2: Standard deviation of it [m/s2].
            up: Unit vector against gravity in the frame of the foot, its z not negative.
            phase: Planned phase of the step.

        Raises:
            ValueError: The acceleration is too large or has no sigma, `up` is no unit vector or points down the leg, or
                there is no such phase.
        """
        if phase not in (*StepPhase,):
            raise ValueError(f"phase: a StepPhase, such as StepPhase.SWING; got {phase!r}")
        if math.isnan(acceleration_m_per_s2) != math.isnan(sigma_m_per_s2):
            raise ValueError("acceleration_m_per_s2 and sigma_m_per_s2: both or neither")
        if abs(acceleration_m_per_s2) > _MOST_M_PER_S2:
            raise ValueError(f"acceleration_m_per_s2: to +-{_MOST_M_PER_S2}, got {acceleration_m_per_s2:g}")
        x, y, z = up
        length = math.hypot(x, y, z)
        if not math.isnan(length) and (abs(length - 1.0) > _MAX_LENGTH - 1.0 or z < 0.0):
            raise ValueError(
                f"up: a unit vector in the frame of the foot, its z not negative; got {x:g}, {y:g}, {z:g}"
            )
        counter = self._counters[node]
        self._counters[node] = next_counter(counter)
        motion = LegMotionFrame(node, counter, phase, acceleration_m_per_s2, sigma_m_per_s2, (x, y, z))
        return LEG_MOTION.can_id + node, LEG_MOTION.encode(motion)
