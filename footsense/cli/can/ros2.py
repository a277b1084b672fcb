"""Command `footsense ros2`: publish the forces received from CAN as ROS 2 messages, live."""

from contextlib import closing

import click

from footsense.cli.can.can_options import ROBOT, can_options
from footsense.cli.options import StopRequest, duration_option
from footsense.client import LinkLimits
from footsense.client.listener import open_listener
from footsense.clock import MonotonicClock, wall_time_ns
from footsense.errors import require
from footsense.frames import ALL_LEGS
from footsense.wires.address import CanAddress, silence_text

#: Period of reading CAN and publishing [ns].
_PUBLISH_PERIOD_NS = 5_000_000
_NS_PER_S = 1_000_000_000


@click.command()
@can_options
@click.option(
    "--domain",
    type=click.IntRange(0, 232),
    default=0,
    envvar="ROS_DOMAIN_ID",
    show_default=True,
    help="Domain of the ROS 2 nodes; without it $ROS_DOMAIN_ID.",
)
@duration_option("Stop after this time.")
@click.pass_context
def ros2(
    ctx: click.Context,
    address: CanAddress,
    domain: int,
    duration_s: float,
) -> None:
    """Publish the legs on CAN to ROS 2 nodes over Zenoh; ROS itself need not be installed (extra ros2).

    Nodes hear it with RMW_IMPLEMENTATION=rmw_zenoh_cpp, others through examples/ros2_relay.py. Only listens on CAN. A
    leg without a usable force sends no wrench; its contact state and /diagnostics say so.
    """
    require("footsense ros2", "ros2", "rosbags", "xxhash", "zenoh")
    from footsense.ros2.live import LiveSamples
    from footsense.ros2.messages import LegTopics
    from footsense.ros2.node import Node

    robot = ctx.meta.get(ROBOT)
    topics, live = LegTopics(ALL_LEGS if robot is None else robot.legs), LiveSamples()
    clock, stop = MonotonicClock(), StopRequest()
    n_published, is_silent, silence = 0, False, silence_text("no frames", address.channel)
    limits = LinkLimits(accept_degraded=True)
    with (
        closing(Node(domain, topics.types)) as node,
        closing(open_listener(address, clock, limits)) as listener,
    ):
        click.echo(f"{address.channel} to ROS 2, domain {domain}; Ctrl-C ends it")
        start_ns = clock.now_ns()
        check_ns = start_ns + _NS_PER_S
        while not stop.requested and (now_ns := clock.now_ns()) < start_ns + duration_s * _NS_PER_S:
            events = listener.listen(now_ns + _PUBLISH_PERIOD_NS)
            wall_ns = wall_time_ns()
            legs = listener.snapshot()
            if now_ns >= check_ns:
                check_ns = now_ns + _NS_PER_S
                if news := node.router_news():
                    click.echo(f"footsense: {news}", err=True)
                if not legs and not is_silent:
                    is_silent = True
                    click.echo(f"footsense: {silence}", err=True)
            samples = live.samples(legs, events, wall_ns, clock.now_ns())
            for topic, cdr in topics.due_messages(samples, wall_ns):
                node.publish(topic, cdr, wall_ns)
                n_published += 1
    click.echo(f"{n_published} messages published")
