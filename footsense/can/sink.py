"""CAN output of the daemon: which frames are sent in which cycle.

Every n-th cycle sends `Force` and `Quality` of every leg, and so does a cycle in which a leg's state, cause, element
mask or flags change; heartbeats go out at 5 Hz, `Baseline`, `Identity` and `Calibration` at 1 Hz, `Ground` at 10 Hz, a
gait event at once, and a fault report when the state, the mask or the cause changes, and at 1 Hz. The counters advance
over frames that the channel did not take, so the consumer sees the gap.

Changes in two cycles in a row share the frames of the second: six legs take 500 kbit/s for longer than a conversion.

Where the channel takes only a part, the rest of the cycle is dropped; each time another leg is first, so that a full
queue costs all legs the same. A leg's Force and Quality are neighbours. A fault report that was not taken is sent again
with the next cycle, with the fault's values at that time; a gait event likewise, with its age.

The loop drives all of this, the heartbeats too. It turns even if no leg answers; if it hangs, its heartbeats stop,
which is their purpose.
"""

import math
from collections.abc import Callable, Sequence
from heapq import heapify, heapreplace
from typing import Any

from firmware_interface.can.codes import NODE_IDS, CalibrationKind, Flag, NmtState
from firmware_interface.can.commands import COMMAND_ID
from firmware_interface.can.crc8 import COUNTER_PERIOD
from firmware_interface.can.force import force_frames
from firmware_interface.can.gait import LEG_MOTION_ID
from firmware_interface.can.reports import (
    BASELINE_ID,
    CALIBRATION_ID,
    FAULT_ID,
    HEARTBEAT_ID,
    IDENTITY_ID,
    PROTOCOL_VERSION,
    CalibrationFrame,
    Identity,
    foot_type_hash,
)
from firmware_interface.wire_timing import FRAMES_PER_LEG, LONGEST_FRAME_BITS
from footsense.can.channel import CanChannel
from footsense.can.commands import CanCommands
from footsense.can.interface import Can
from footsense.can.leg_frames import CanLeg, GaitFrames, heartbeat_frame, heartbeat_of_state
from footsense.can.motions import CanMotions
from footsense.frames import CanStatistics, Command, CommandResult, ContactFrame, LegMotion
from footsense.ports import CanWire, Clock

#: Most frames beside Force and Quality in one cycle, for which the interface's queue has room too; the others wait for
#: the next. Least room of the queue, that of six legs (`deploy/80-can0.network`).
_MAX_EXTRA_FRAMES, _LEAST_QUEUE_FRAMES = 4, 16

#: Those that a start sends, and that are due again a period later: the first fault report is that of the first state.
_SENT_AT_START = {IDENTITY_ID, FAULT_ID}

#: A plain number: arithmetic with an enumeration costs a microsecond each time.
_DEGRADED_TIMING = int(Flag.DEGRADED_TIMING)

#: Frames that each leg sends at times of its own: period [ns], and the first time, over the time between two legs [1].
#: A start sends identities, and fault reports of the first state.
_PERIODIC = {
    HEARTBEAT_ID: (200_000_000, 0.0),
    BASELINE_ID: (1_000_000_000, 0.0),
    CALIBRATION_ID: (1_000_000_000, 0.5),
    IDENTITY_ID: (1_000_000_000, 1.0),
    FAULT_ID: (1_000_000_000, 1.5),
}


class CanSink:
    """CAN output: publishes forces and reports, and receives commands and motions.

    Args:
        can: The interface.
        legs: Name of the leg in each row of the frames.
        clock: The time of the frames.
        cycles_per_force: Cycles for each `Force`, at least 1.
        force_step_mn: What a bit of a force stands for [mN].
        foot_type: Type of the feet.
        calibrations: First `Calibration` of each leg, of any node; none where no foot is calibrated.
        connect: As of `CanChannel`.

    Attributes:
        stats: Statistics of the channel.

    Raises:
        CanError: The channel is missing or down.

    Timing:
        Never waits. Six legs: 12 frames for each force, and 30 heartbeats, 24 reports and 60 grounds a second.
    """

    def __init__(
        self,
        can: Can,
        legs: tuple[str, ...],
        clock: Clock,
        *,
        cycles_per_force: int = 1,
        force_step_mn: int = 1,
        foot_type: str = "",
        calibrations: Sequence[CalibrationFrame] = (),
        connect: Callable[[], CanWire] | None = None,
    ) -> None:
        self.stats = CanStatistics()
        nodes = [NODE_IDS[leg] for leg in legs]
        identity = Identity(0, 0, PROTOCOL_VERSION, force_step_mn, foot_type_hash(foot_type))
        none = CalibrationFrame(0, 0, CalibrationKind.NONE, None, math.nan, math.nan)
        self._legs = [
            CanLeg(row, identity._replace(node=node), calibration._replace(node=node))
            for row, (node, calibration) in enumerate(
                zip(nodes, calibrations or [none] * len(nodes), strict=True)
            )
        ]
        boot = [heartbeat_frame(node, NmtState.BOOT) for node in nodes]
        self._channel = CanChannel(
            can,
            accept=[base + node for base in (COMMAND_ID, LEG_MOTION_ID) for node in nodes],
            # A consumer has to know the step before the first force.
            first_frames=boot + [leg.identity_frame() for leg in self._legs],
            stats=self.stats,
            connect=connect,
        )
        self._obeys = can.executes_commands
        self._n_force_frames = FRAMES_PER_LEG * len(nodes)
        self._queue_frames = max(self._n_force_frames + _MAX_EXTRA_FRAMES, _LEAST_QUEUE_FRAMES)
        # Our frames in the queue by now, if no other node sends, and the time of a frame on the bus [ns].
        self._n_queued, self._t_ns, self._frame_ns = 0.0, clock.now_ns(), LONGEST_FRAME_BITS * can.bit_ns
        self._nodes = nodes
        self._clock = clock
        self._gait = GaitFrames(nodes)
        self._commands = CanCommands(self._channel, nodes, clock)
        self._motions = CanMotions(nodes, clock, self.stats)
        self._cycles_per_force = cycles_per_force
        self._force_step_mn = force_step_mn
        self._n_cycles = cycles_per_force - 1  # since the last forces
        self._early = False  # the last forces were sent for a change
        self._sent: list[list[int]] = []  # states, masks, causes and flags of the last forces
        self._counter = 0  # of every Force and Quality of a cycle
        self._first = 0  # frame that is sent first
        self._reported: list[list[int]] = []  # states, masks and causes without an outstanding report
        # Due time [ns], period [ns], kind and row of each periodic frame, as a heap; the legs' phases are spread over
        # the period, so that their frames do not pile up in one cycle.
        now_ns = clock.now_ns()
        self._due = [
            (now_ns + round((row + first) * period_ns / len(nodes)), period_ns, kind, row)
            for row in range(len(nodes))
            for kind, (period_ns, first) in _PERIODIC.items()
        ]
        heapify(self._due)
        self._flags = [0] * len(nodes)
        self._closed = False

    def publish(self, frame: ContactFrame) -> None:
        """Send the gait events, forces, reports and periodic frames that are due."""
        t_ns = frame.t_sent_ns
        present = [frame.state.tolist(), frame.fault_mask.tolist(), frame.cause.tolist()]
        self._flags = frame.flags.tolist()
        gait = self._gait
        if frame.gait is not None:
            gait.queue_gait(frame.gait)
        unreported = [] if present == self._reported else self._unreported_fault_changes(present)
        self._n_queued = max(0.0, self._n_queued - (t_ns - self._t_ns) / self._frame_ns)
        self._t_ns = t_ns
        are_forces_due = self._are_forces_due([*present, self._flags])
        room = self._queue_frames - math.ceil(self._n_queued) - are_forces_due * self._n_force_frames
        # One always: where forces alone fill the bus, heartbeats and reports come all the same.
        max_extra_frames = min(_MAX_EXTRA_FRAMES, max(room, 1))
        reports = unreported[:max_extra_frames]
        frames = gait.event_frames(t_ns, max_extra_frames - len(reports)) if gait.events else []
        n_events = n_before = len(frames)
        if are_forces_due:
            frames += self._force_frames(frame, present[0])
            n_before = len(frames)
        for leg, report in reports:
            frames.append(leg.fault_frame(*report))
        max_frames = max_extra_frames - len(reports) - n_events
        if t_ns >= self._due[0][0]:
            max_frames = self._add_periodic_frames(frames, frame, present, max_frames)
        if self._commands.unsolicited:
            unsolicited = self._commands.pop_unsolicited_frames(max_frames)
            max_frames -= len(unsolicited)
            frames += unsolicited
        if gait.waiting:
            frames += gait.pop_periodic_frames(max_frames)
        if not frames:
            return
        taken = self._channel.send(frames, t_ns)
        self._n_queued = min(self._n_queued + taken, self._queue_frames)
        gait.drop_sent_events(min(n_events, taken))
        n_reported = min(len(reports), max(0, taken - n_before))
        for leg, report in reports[:n_reported]:
            leg.set_reported(report)
        if n_reported == len(unreported):
            self._reported = present

    def _are_forces_due(self, present: list[list[int]]) -> bool:
        """Return whether this cycle's forces are to be sent: at the interval, or early after a change of state.

        Args:
            present: States, masks, causes and flags of the legs.
        """
        self._n_cycles += 1
        early = self._n_cycles < self._cycles_per_force
        flickers = self._early and self._n_cycles < 2
        is_full = self._n_queued + self._n_force_frames > self._queue_frames
        if early and (present == self._sent or flickers or is_full):
            return False
        self._n_cycles, self._early, self._sent = 0, early, present
        return True

    def _force_frames(self, frame: ContactFrame, states: list[int]) -> list[bytes]:
        """Return all legs' Force and Quality frames, from another leg on each time."""
        force_n, sigma_n = frame.force_n, frame.sigma_n
        if self._force_step_mn != 1:
            force_n, sigma_n = force_n / self._force_step_mn, sigma_n / self._force_step_mn
        legs = (frame.t_ns.tolist(), states, force_n.tolist(), sigma_n.tolist(), self._flags)
        contact = frame.contact_probability.tolist(), frame.holds.tolist()
        counter, self._counter = self._counter, (self._counter + 1) % COUNTER_PERIOD
        self.stats.published_cycles += 1
        forces = force_frames(self._nodes, counter, frame.t_sent_ns, *legs, *contact)
        # A full queue drops frames at its front or refuses them at its end: rotate, so that it strikes each leg.
        self._first = (self._first + 2) % len(forces)
        return forces[self._first :] + forces[: self._first]

    def commands(self) -> list[Command]:
        """Return the valid commands among the received frames, and take the motions; invalid ones are counted."""
        frames = self._channel.receive()
        if not frames:
            return []
        motions = [frame for frame in frames if frame[0] > LEG_MOTION_ID]
        commands = [frame for frame in frames if frame[0] < LEG_MOTION_ID]
        if not self._obeys:
            stats = self.stats
            stats.received_commands += len(commands)
            stats.rejected_commands += len(commands)
            stats.received_motions += len(motions)
            stats.rejected_motions += len(motions)
            return []
        self._motions.take(motions)
        return self._commands.decode(commands)

    def new_motion(self) -> LegMotion | None:
        """Return the motions of all legs if one has changed since the last call, else None."""
        return self._motions.pop_new()

    def answer(self, outcome: CommandResult) -> None:
        """Send a command's result under its leg's answer id, with the command's counter."""
        self._commands.answer(outcome)

    def close(self) -> None:
        """Send each leg's last heartbeat, `stopped`, and close the interface; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        last = [
            heartbeat_frame(leg.node, NmtState.STOPPED, degraded_timing=bool(flags & _DEGRADED_TIMING))
            for leg, flags in zip(self._legs, self._flags, strict=True)
        ]
        self._channel.send(last, self._clock.now_ns())
        self._channel.close()

    def _unreported_fault_changes(self, present: list[list[int]]) -> list[tuple[CanLeg, Any]]:
        """Return the legs whose state, mask or cause has changed since their last report, with the new values."""
        of_legs = zip(self._legs, zip(*present, strict=True), strict=True)
        return [(leg, report) for leg, report in of_legs if leg.reported != report]

    def _add_periodic_frames(
        self, frames: list[bytes], frame: ContactFrame, present: list[list[int]], max_frames: int
    ) -> int:
        """Append the periodic frames that are due, at most `max_frames`; return how many more fit.

        Missed ones are not made up for.
        """
        now_ns, due = frame.t_sent_ns, self._due
        while max_frames and now_ns >= due[0][0]:
            due_ns, period_ns, kind, row = due[0]
            leg = self._legs[row]
            if kind == HEARTBEAT_ID:
                degraded_timing = bool(self._flags[row] & _DEGRADED_TIMING)
                frames.append(heartbeat_of_state(leg.node, present[0][row], degraded_timing))
            elif kind == BASELINE_ID:
                frames.append(leg.baseline_frame(frame))
            elif kind == IDENTITY_ID:
                frames.append(leg.identity_frame())
            elif kind == CALIBRATION_ID:
                frames.append(leg.calibration_frame())
            elif leg.reported == tuple(column[row] for column in present):  # else the change tells it
                frames.append(leg.repeated_fault_frame())
            heapreplace(
                due, (due_ns + (1 + (now_ns - due_ns) // period_ns) * period_ns, period_ns, kind, row)
            )
            max_frames -= 1
        return max_frames
