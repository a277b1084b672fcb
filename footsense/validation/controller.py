"""A gait controller on CAN that walks with a soak: it commands legs at random, tells their motions, and hears answers.

Now and then a frame of it is damaged, or comes twice.
"""

from collections.abc import Callable, Sequence

import numpy as np

from firmware_interface.can.codes import NODE_IDS, CommandKind, StepPhase
from firmware_interface.can.commands import ANSWER_ID
from firmware_interface.can.crc8 import COUNTER_PERIOD, kind_and_node
from firmware_interface.can.socketcan import pack_frame, unpack_frame
from footsense.client.commands import PendingCommands
from footsense.client.motions import Motions
from footsense.frames import Cycle, Vector
from footsense.ports import Observer
from footsense.sim.can.interface import SimulatedCan

#: Period of the motions [ns], and mean time between two commands [ns].
_MOTION_PERIOD_NS, _MEAN_COMMAND_NS = 20_000_000, 3_000_000_000
#: A stopped leg is started again after that time [ns].
_STOPPED_NS = 1_500_000_000
#: Time after which a command should have its answer [ns].
_ANSWER_TIME_NS = 1_000_000_000
_LEG_OF_NODE = {node: leg for leg, node in NODE_IDS.items()}
#: Shares of frames that are damaged, and that come twice.
_DAMAGED_REL, _TWICE_REL = 0.01, 0.01
#: Standard deviation of what it tells of accelerations [m/s2].
_ACCELERATION_M_PER_S2 = 2.0


class Controller(Observer):
    """Observer that sends commands and motions with the time of the service, and hears its answers.

    Args:
        can: The bus.
        legs: Names of the legs.
        true_force_n_at: Returns the true force on every foot at a time [ns -> N, shape (legs, 3)].
        rng: Source of randomness.

    Attributes:
        n_commands: Commands that it has sent.
        n_answers: Answers that it has heard.
    """

    def __init__(
        self,
        can: SimulatedCan,
        legs: Sequence[str],
        true_force_n_at: Callable[[int], Vector],
        rng: np.random.Generator,
    ) -> None:
        self._can, self._nodes, self._rng = can, [NODE_IDS[leg] for leg in legs], rng
        self._true_force_n_at = true_force_n_at
        self._motions = Motions()
        self._pending = PendingCommands(int(rng.integers(COUNTER_PERIOD)))
        self._sent: set[tuple[str, int]] = set()  # leg and time of each command without an answer
        self._motion_due_ns = 0
        self._command_due_ns = self._later_ns(0)
        self._starts: list[tuple[int, int]] = []  # time of the start, node of a leg that may be stopped
        self.n_commands = self.n_answers = 0

    def observe(self, cycle: Cycle) -> None:
        """Send what is due."""
        now_ns = cycle.forces.t_sent_ns
        if now_ns >= self._motion_due_ns:
            self._motion_due_ns = now_ns + _MOTION_PERIOD_NS
            self._send_motions(now_ns)
        if self._starts and now_ns >= self._starts[0][0]:
            self._command(self._starts.pop(0)[1], CommandKind.START, now_ns)
        if now_ns >= self._command_due_ns:
            self._command_due_ns = self._later_ns(now_ns)
            kind = (CommandKind.TARE, CommandKind.STOP)[int(self._rng.integers(2))]
            node = int(self._rng.choice(self._nodes))
            self._command(node, kind, now_ns)
            if kind is CommandKind.STOP:
                self._starts.append((now_ns + _STOPPED_NS, node))

    def hear(self, frame: bytes, t_ns: int) -> None:
        """Process a frame of the service.

        Args:
            frame: The frame, as in `firmware_interface.can.socketcan`.
            t_ns: Time of its arrival [ns].
        """
        can_id, data = unpack_frame(frame)
        if kind_and_node(can_id)[0] == ANSWER_ID and (answer := self._pending.feed(can_id, data, t_ns)):
            self.n_answers += 1
            sent_ns = t_ns - answer.response_time_ns
            self._sent.discard((_LEG_OF_NODE[answer.node], sent_ns))

    def unanswered(self, now_ns: int) -> list[tuple[str, int]]:
        """Return leg and time [ns] of each command without an answer, but for those of a moment ago."""
        return sorted(command for command in self._sent if now_ns - command[1] > _ANSWER_TIME_NS)

    def _later_ns(self, now_ns: int) -> int:
        return now_ns + round(self._rng.exponential(_MEAN_COMMAND_NS))

    def _command(self, node: int, kind: CommandKind, now_ns: int) -> None:
        self.n_commands += 1
        self._sent.add((_LEG_OF_NODE[node], now_ns))
        frame = self._pending.encode(node, kind, now_ns)
        self._can.deliver_to_sockets(pack_frame(*frame))
        if self._rng.random() < _TWICE_REL:
            self._can.deliver_to_sockets(pack_frame(*frame))

    def _send_motions(self, now_ns: int) -> None:
        true_n = self._true_force_n_at(now_ns)
        for row, node in enumerate(self._nodes):
            stands = bool(true_n[row].any())
            can_id, data = self._motions.encode(
                node,
                acceleration_m_per_s2=0.0 if stands else _ACCELERATION_M_PER_S2 * float(self._rng.normal()),
                sigma_m_per_s2=_ACCELERATION_M_PER_S2,
                up=(0.0, 0.0, 1.0),
                phase=StepPhase.STANCE if stands else StepPhase.SWING,
            )
            if self._rng.random() < _DAMAGED_REL:
                data = bytes([data[0] ^ 1, *data[1:]])
            self._can.deliver_to_sockets(pack_frame(can_id, data))
