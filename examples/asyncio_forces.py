"""Take the forces in a program of asyncio, beside other tasks, and hear of each touchdown as soon as it arrives.

In another terminal: footsense run --config deploy/simulated.yaml. Ends when the robot is silent for 2 s.
"""

import argparse
import asyncio
import signal
import sys

import footsense

for end in (signal.SIGPIPE, signal.SIGINT):  # `| head` and Ctrl-C end it without a word
    signal.signal(end, signal.SIG_DFL)


async def tell_touchdowns(events: asyncio.Queue[footsense.FootEvent]) -> None:
    """Print each touchdown, until the task is cancelled."""
    while True:
        event = await events.get()
        if event.kind == "touchdown":
            print(f"{event.leg}: touchdown")


async def main(channel: str) -> None:
    """Print twice a second how much of the load the left legs carry, and the touchdowns meanwhile."""
    loop, events = asyncio.get_running_loop(), asyncio.Queue[footsense.FootEvent]()
    # What waits for an answer of the robot, as `connect` and `tare` do, waits in a thread.
    with await asyncio.to_thread(footsense.connect, channel) as feet:
        feet.on_event(lambda event: loop.call_soon_threadsafe(events.put_nowait, event))
        task, next_s = asyncio.create_task(tell_touchdowns(events)), loop.time()
        async for forces in feet:
            if loop.time() >= next_s and all(force.usable for force in forces.values()):
                load_n = {leg: force.force_n[2] for leg, force in forces.items()}
                left_n = sum(load_n[leg] for leg in load_n if leg.startswith("l"))
                print(f"left legs: {left_n:.2f} of {sum(load_n.values()):.2f} N")
                next_s = loop.time() + 0.5
        task.cancel()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--can", default="239.74.163.2", help="on a robot: can0")
    try:
        asyncio.run(main(parser.parse_args().can))
    except footsense.FootsenseError as error:
        sys.exit(str(error))
