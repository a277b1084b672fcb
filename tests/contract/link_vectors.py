"""Makes `firmware_interface/vectors/link.json`: what a consumer sees of one leg, frame by frame.

The frames come from the encoders; the statuses are said here by hand, for a decoder in any language to meet.
Make them anew with `python -m tests.contract.link_vectors`.
"""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

from firmware_interface.can.codes import State
from firmware_interface.can.crc8 import protect
from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from firmware_interface.can.reports import HEARTBEAT_ID, IDENTITY, IDENTITY_ID, PROTOCOL_VERSION, Identity
from tests.support.can_frames import encode_force, encode_quality

__all__ = ["PATH", "document"]

PATH = Path(__file__).parents[2] / "firmware_interface/vectors/link.json"

NODE = 2
PERIOD_US = 25_000
#: Between the two frames of a force.
GAP_US = 270
FORCE_N = (0.1, -0.05, 0.8)
SIGMA_N = (0.02, 0.02, 0.04)

STALE, OK, LOST, REPEATED, WRONG = "stale", "ok", "lost", "repeated", "wrong"
UNKNOWN, REFUSED, CONFLICT = "unknown", "refused", "conflict"


def force(counter: int, state: State = State.VALID, node: int = NODE) -> tuple[int, bytes]:
    """Return id and data of a force."""
    return FORCE_ID + node, encode_force(node, counter, state, FORCE_N)


def quality(
    counter: int, age_us: int | None = 15_000, sigma_n: tuple[float, float, float] = SIGMA_N
) -> tuple[int, bytes]:
    """Return id and data of a quality."""
    age_ns = None if age_us is None else age_us * 1000
    return QUALITY_ID + NODE, encode_quality(NODE, counter, 0, age_ns, sigma_n)


def identity(
    counter: int = 0, *, version: int = PROTOCOL_VERSION, step_mn: int = 1, foot_type: int = 0x01020304
) -> tuple[int, bytes]:
    """Return id and data of an identity."""
    return IDENTITY_ID + NODE, IDENTITY.encode(Identity(NODE, counter, version, step_mn, foot_type))


@dataclass
class Case:
    """One sequence: steps of time, frame (None to look only), and what is expected after it.

    Unless `identified` is false, the first is the identity of the frames.
    """

    name: str
    limits: dict[str, int | bool] = field(default_factory=dict)
    steps: list[list[int | str | bool | None]] = field(default_factory=list)
    t_us: int = 1_000_000
    identified: bool = True

    def __post_init__(self) -> None:
        if self.identified:
            self.feed(identity(), STALE)

    def feed(self, frame: tuple[int, bytes], status: str, *, usable: bool | None = None) -> "Case":
        """Add a frame. `usable` is said where the status alone does not tell."""
        can_id, data = frame
        self.steps.append([self.t_us, can_id, data.hex(), status, _usable(status, usable)])
        return self

    def look(self, after_us: int, status: str, *, usable: bool | None = None) -> "Case":
        """Look without a frame."""
        self.t_us += after_us
        self.steps.append([self.t_us, None, None, status, _usable(status, usable)])
        return self

    def pair(
        self,
        counter: int,
        status: str,
        *,
        before: str | None = None,
        state: State = State.VALID,
        age_us: int | None = 15_000,
        usable: bool | None = None,
        used_before: bool | None = None,
    ) -> "Case":
        """Add a force and its quality one scan later; after the first of the two the view is as before."""
        self.t_us += PERIOD_US
        self.feed(
            force(counter, state), before or status, usable=usable if used_before is None else used_before
        )
        self.t_us += GAP_US
        self.feed(quality(counter, age_us), status, usable=usable)
        self.t_us -= GAP_US
        return self

    def each_second(self, *statuses: str, first: int = 6, identities: bool = True) -> "Case":
        """Add seconds with a force each 50 ms, counting on, and in the end of each an identity, counting from 2 on."""
        for number, status in enumerate(statuses):
            before = self.steps[-1][3]
            for force_number in range(20):
                self.t_us += PERIOD_US
                is_last = force_number == 19
                self.pair(
                    (first + 20 * number + force_number) % 15,
                    str(status if is_last else before),
                    before=str(before),
                )
            if identities:
                self.t_us += GAP_US
                self.feed(identity(2 + number), status)
                self.t_us -= GAP_US
        return self

    def trusted(self) -> "Case":
        """Add what it takes to be trusted: three forces in order, counters 0 to 2."""
        return self.pair(0, STALE).pair(1, STALE).pair(2, OK, before=STALE)


def _usable(status: str, usable: bool | None) -> bool:  # noqa: FBT001 - a value, not an option
    return status in {OK, LOST} if usable is None else usable


def _spoilt(frame: tuple[int, bytes]) -> tuple[int, bytes]:
    can_id, data = frame
    return can_id, data[:-1] + bytes([data[-1] ^ 0x10])


def _holed(counter: int) -> tuple[int, bytes]:
    """Return a force that no service sends: its state is VALID, and its second component is the code of no value."""
    can_id = FORCE_ID + NODE
    return can_id, protect(can_id, bytes((State.VALID << 4 | counter, 100, 0, 0, 0x80, 100, 0)))


def _silent(name: str, for_us: int) -> Case:
    """Return a case whose leg is trusted, and then has nothing complete for a time, up to the next pair."""
    return Case(name).trusted().look(for_us - PERIOD_US - GAP_US, STALE)


def cases() -> list[Case]:
    """Return every sequence."""
    order = Case("in order, and the counter wraps from 14 to 0").trusted()
    for counter in (*range(3, 15), 0, 1, 2):
        order.pair(counter, OK)

    silence = Case("silence: stale by age, then by time; three forces in order until it is trusted again")
    silence.trusted().look(80_000, OK).look(5_001, STALE).look(60_000, STALE)
    silence.pair(7, STALE).pair(8, STALE).pair(9, OK, before=STALE)

    old = Case("a force that was old when it was sent, or of unknown age").trusted()
    old.pair(3, STALE, before=OK, age_us=100_100, used_before=True).pair(4, OK, before=STALE)
    old.pair(5, STALE, before=OK, age_us=None, used_before=True).pair(6, STALE, age_us=100_000)
    # What the age says, and the time since the force arrived: 99.7 ms and 0.3 ms are just within 100 ms.
    old.pair(7, OK, before=STALE, age_us=99_700).look(300, OK).look(1, STALE)
    return [
        order,
        Case("nothing was ever heard").look(0, STALE),
        Case("one and two lost")
        .trusted()
        .pair(4, LOST, before=OK)
        .pair(5, OK, before=LOST)
        .pair(8, LOST, before=OK),
        Case("three lost is too large a gap")
        .trusted()
        .pair(6, WRONG, before=OK, used_before=True, usable=False)
        .pair(7, WRONG)
        .pair(8, WRONG)
        .pair(9, OK, before=WRONG),
        Case("a force comes twice, and then the next")
        .trusted()
        .feed(force(2), REPEATED)
        .feed(quality(2), REPEATED)
        .pair(3, OK, before=REPEATED),
        Case("the counter stands still: repeated, then stale")
        .trusted()
        .pair(2, REPEATED)
        .pair(2, REPEATED)
        .look(26_000, REPEATED)
        .pair(2, STALE),
        Case("wrong crc of a force")
        .trusted()
        .feed(_spoilt(force(3)), WRONG)
        .pair(3, WRONG)
        .pair(4, WRONG)
        .pair(5, OK, before=WRONG),
        Case("wrong crc of a quality, and one loss on the way back")
        .trusted()
        .feed(_spoilt(quality(3)), WRONG)
        .pair(4, WRONG)
        .pair(5, WRONG)
        .pair(7, LOST, before=WRONG),
        Case("a wrong frame between the two of a force takes the first away", {"min_good": 1})
        .pair(9, OK, before=STALE)
        .feed(force(10), OK)
        .feed(_spoilt(quality(10)), WRONG)
        .feed(quality(10), WRONG)
        .feed(force(10), OK),
        Case("the same with the quality first", {"min_good": 1})
        .pair(9, OK, before=STALE)
        .feed(quality(10), OK)
        .feed(_spoilt(force(10)), WRONG)
        .feed(force(10), WRONG)
        .feed(quality(10), OK),
        Case("the first of the two comes twice", {"min_good": 1})
        .pair(9, OK, before=STALE)
        .feed(force(10), OK)
        .feed(force(10), REPEATED)
        .feed(quality(10), OK)
        .feed(quality(11), OK)
        .feed(quality(11), REPEATED)
        .feed(force(11), OK),
        Case("wrong twice: three forces in order each time, whatever came before")
        .trusted()
        .feed(_spoilt(force(3)), WRONG)
        .pair(3, WRONG)
        .pair(4, WRONG)
        .feed(_spoilt(force(5)), WRONG)
        .pair(5, WRONG)
        .pair(6, WRONG)
        .pair(7, OK, before=WRONG),
        Case("another leg's frame under this leg's id")
        .trusted()
        .feed((FORCE_ID + NODE, force(3, node=5)[1]), WRONG),
        Case("frames of other legs and of other kinds say nothing about this one")
        .trusted()
        .feed(_spoilt(force(3, node=5)), OK)
        .feed((FORCE_ID + 1, b""), OK)
        .feed((HEARTBEAT_ID + NODE, b"\x04"), OK)
        .feed((0x159, bytes(8)), OK)
        .feed((FORCE_ID + 8, bytes(8)), OK)
        .feed((FORCE_ID, bytes(8)), OK),
        Case("too short, and a counter that is never sent")
        .trusted()
        .feed((FORCE_ID + NODE, force(3)[1][:7]), WRONG)
        .feed((FORCE_ID + NODE, bytes.fromhex("00")), WRONG)
        .feed((FORCE_ID + NODE, b""), WRONG),
        Case("wrong frames alone: wrong, then stale")
        .feed(_spoilt(force(0)), WRONG)
        .look(100_000, WRONG)
        .look(1, STALE),
        silence,
        old,
        Case("a force without its quality is not used; the next pair shows the loss")
        .trusted()
        .feed(force(3), OK)
        .pair(4, LOST, before=OK),
        Case("the first half of a force waits no longer than a force may be away")
        .trusted()
        .feed(force(3), OK)
        .look(100_001, STALE)
        .feed(quality(3), STALE)
        .feed(force(3), STALE)
        .pair(4, STALE)
        .pair(5, OK, before=STALE),
        Case("quality first").trusted().feed(quality(3), OK).feed(force(3), OK),
        Case("states that forbid the force: the link is in order, and bad news acts at once")
        .trusted()
        .pair(3, OK, state=State.ELEMENT_FAULT, usable=False)
        .pair(4, OK, state=State.ABSENT, age_us=None, usable=False)
        .pair(5, OK, state=State.STARTING, age_us=None, usable=False)
        .pair(6, OK, used_before=False)
        .pair(7, OK, state=State.DEGRADED, usable=False, used_before=True)
        .pair(8, OK, used_before=False),
        Case("a valid force with a component that is no number is not used, and the next one is")
        .trusted()
        .look(PERIOD_US, OK)
        .feed(_holed(3), OK)
        .feed(quality(3), OK, usable=False)
        .pair(4, OK, used_before=False),
        Case("a valid force without a sigma is not used, and the next one is")
        .trusted()
        .look(PERIOD_US, OK)
        .feed(force(3), OK)
        .feed(quality(3, sigma_n=(0.02, 0.02, math.nan)), OK, usable=False)
        .pair(4, OK, used_before=False),
        Case("no identity: in order and not used, until one comes; a damaged one is none", identified=False)
        .pair(0, STALE)
        .pair(1, STALE)
        .pair(2, UNKNOWN, before=STALE)
        .feed(_spoilt(identity()), UNKNOWN)
        .feed(identity(), OK),
        Case("a version that is not known is refused", identified=False)
        .feed(identity(version=PROTOCOL_VERSION + 1), STALE)
        .pair(0, STALE)
        .pair(1, STALE)
        .pair(2, REFUSED, before=STALE),
        Case("a step that is not known is refused", identified=False)
        .feed(identity(step_mn=3), STALE)
        .pair(0, STALE)
        .pair(1, STALE)
        .pair(2, REFUSED, before=STALE),
        Case("an identity that counts on, or is sent again, changes nothing")
        .trusted()
        .look(GAP_US, OK)
        .feed(identity(1), OK)
        .look(10_000, OK)
        .feed(identity(1), OK)
        .look(10_000, OK)
        .feed(identity(2), OK),
        *(
            Case(f"two services, {what}: nothing is used until one has been alone for three seconds")
            .trusted()
            .look(GAP_US, OK)
            .feed(second, CONFLICT)
            .pair(3, CONFLICT)
            .pair(4, CONFLICT)
            .pair(5, CONFLICT)
            .feed(identity(1), CONFLICT)
            .each_second(CONFLICT, CONFLICT, OK)
            for what, second in {
                "another step": identity(1, step_mn=10),
                "another foot": identity(1, foot_type=0x01020305),
                "by their counters": identity(9),
            }.items()
        ),
        Case("two services that count alike: the same identity comes again too late to be sent again")
        .trusted()
        .look(GAP_US, OK)
        .feed(identity(1), OK)
        .look(10_001, OK)
        .feed(identity(1), CONFLICT),
        Case("an identity that comes late may have lost one before it")
        .trusted()
        .each_second(OK, OK, first=3, identities=False)
        .feed(identity(2), OK),
        _silent("a silence in which no service can start anew needs no other identity", 300_000)
        .pair(3, STALE)
        .pair(4, STALE)
        .pair(5, OK, before=STALE),
        _silent("after a longer one its forces wait for the next identity", 300_001)
        .pair(3, STALE)
        .pair(4, STALE)
        .pair(5, UNKNOWN, before=STALE)
        .feed(identity(), OK),
        _silent("or for one that came just before them", 300_001)
        .feed(identity(), STALE)
        .pair(3, STALE)
        .pair(4, STALE)
        .pair(5, OK, before=STALE),
        Case("degraded forces where they are accepted", {"accept_degraded": True})
        .trusted()
        .pair(3, OK, state=State.DEGRADED),
        Case("one good force is enough, no loss is allowed", {"min_good": 1, "max_delta": 1})
        .pair(9, OK, before=STALE)
        .pair(11, WRONG, before=OK, used_before=True, usable=False)
        .pair(12, OK, before=WRONG),
    ]


def document() -> str:
    """Return the file's text."""
    about = (
        "What a consumer sees of the leg of `node`, frame by frame. A step is time in us, CAN id, data, and the status "
        "after it and whether the force may be used then; without id and data it is a look only. Limits are those of "
        "FOOTSENSE_DEFAULT_LIMITS but for what a case names."
    )
    lines = [f'{{\n "about": {json.dumps(about)},\n "node": {NODE},\n "cases": [']
    lines.append(
        ",\n".join(
            f'  {{"name": {json.dumps(case.name)}, "limits": {json.dumps(case.limits)}, "steps": [\n'
            + ",\n".join(f"   {json.dumps(step)}" for step in case.steps)
            + "\n  ]}"
            for case in cases()
        )
    )
    return "\n".join(lines) + "\n ]\n}\n"


if __name__ == "__main__":
    PATH.write_text(document(), encoding="utf-8")
