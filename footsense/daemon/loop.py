"""Main loop: read a frame, execute commands, estimate forces, publish them, notify observers.

It runs the same over hardware, over the simulator and over a recording; all that differs is behind its ports. The
source sets the pace: a scanner waits for its conversions. Nothing else may run Python in this process while the loop
does: recorder and CAN log write in processes of their own, and metrics are served by another.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from footsense.can.sink import CanSink
from footsense.estimation.pipeline import Pipeline
from footsense.frames import CapFrame, Command, Cycle, LegMotion, ReferenceSamples, Vector
from footsense.ports import Clock, FrameSource, Observer, ReferenceSensor


@dataclass
class Loop:
    """Main loop with its pipeline, outputs and observers; the caller closes them.

    Attributes:
        pipeline: Estimates the contact forces.
        sink: Takes forces, gives commands.
        observers: Notified of every cycle; more may be added between two runs.
        clock: Clock of the frames' stamps.
        reference: Force sensor of a test stand.
        temperature_c: Returns the last temperature of each foot [degC], shape (legs,), NaN for an unknown one, called
            once a cycle; None where the source of the frames has none.
    """

    pipeline: Pipeline
    sink: CanSink
    observers: Sequence[Observer]
    clock: Clock
    reference: ReferenceSensor | None = None
    temperature_c: Callable[[], Vector] | None = None

    def run_until(self, source: FrameSource, stop: Callable[[], bool], until_ns: float = math.inf) -> None:
        """Run cycles until the source ends, `stop` returns true, or the clock reaches a time.

        Args:
            source: Source of frames.
            stop: Stop condition, called once a cycle.
            until_ns: Time of the end [ns].
        """
        last_temperature_c: Vector | None = None
        while not stop() and self.clock.now_ns() < until_ns:
            scan = source.read()
            if scan is None:
                return
            samples = None if self.reference is None else self.reference.read(self.clock.now_ns())
            new_c = None
            if self.temperature_c is not None:
                now_c = self.temperature_c()
                if last_temperature_c is None or not np.array_equal(
                    now_c, last_temperature_c, equal_nan=True
                ):
                    last_temperature_c = new_c = now_c
            commands = tuple(self.sink.commands())
            self.run_cycle(scan, commands, samples, new_c, self.sink.new_motion())

    def run_cycle(
        self,
        scan: CapFrame,
        commands: tuple[Command, ...],
        reference: ReferenceSamples | None = None,
        temperature_c: Vector | None = None,
        motion: LegMotion | None = None,
    ) -> Cycle:
        """Run one cycle on a frame: execute commands, estimate, publish, notify observers; return the cycle."""
        pipeline, sink = self.pipeline, self.sink
        if temperature_c is not None:
            pipeline.set_temperature(temperature_c)
        if motion is not None:
            pipeline.set_motion(motion)
        immediate = tuple(map(pipeline.execute, commands))
        forces, ended = pipeline.process(scan, self.clock.now_ns())
        sink.publish(forces)
        outcomes = (*filter(None, immediate), *ended)
        cycle = Cycle(scan, commands, forces, outcomes, reference, temperature_c, motion)
        for outcome in cycle.ended_commands:
            sink.answer(outcome)
        for observer in self.observers:
            observer.observe(cycle)
        return cycle
