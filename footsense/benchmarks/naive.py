"""Naive program for the work of one daemon cycle, for comparison in `footsense dev benchmark`.

It scans leg by leg and element by element and waits for each conversion; it infers leg by leg, encodes with cantools,
builds every CAN message anew, looks every metric up by its labels, and records JSON. Nothing of the daemon uses this.
"""

import importlib.util
import json
import os
import socket
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import firmware_interface
from firmware_interface.can import crc8
from firmware_interface.chips import tca9548a
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.frames import CapFrame, ContactFrame, Flag, State
from footsense.ports import Clock, I2cBus, Transaction


def sequential_scan(bus: I2cBus, clock: Clock, config: Config) -> None:
    """Convert and read every element of every leg of the first bus, one after the other."""
    plan = config.triggered_plan
    for channel in config.buses[0].channels.values():
        for step in plan.steps:
            bus.transfer(
                Transaction(config.buses[0].mux.address, bytes((tca9548a.channel_control_byte(channel),)))
            )
            bus.transfer(step.select)
            bus.transfer(step.trigger)
            clock.sleep_until_ns(clock.now_ns() + plan.conversion_wait_ns)
            for read in (step.done.read, *step.read_value):
                bus.transfer(read)


def has_cantools() -> bool:
    """Return whether cantools is installed; only the naive program needs it."""
    return importlib.util.find_spec("cantools") is not None


class NaiveCycle:
    """One daemon cycle written naively: leg by leg, with one inference each and cantools for each message.

    Args:
        config: The robot.
    """

    def __init__(self, config: Config) -> None:
        import cantools
        from can import Message
        from can.interfaces.socketcan.socketcan import build_can_frame
        from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

        self._message, self._frame = Message, build_can_frame
        self._database = cantools.database.load_file(
            Path(firmware_interface.__file__).parent / "can/footsense.dbc"
        )
        self._legs = config.legs
        # A configuration of one leg gives a pipeline and a network of one row.
        single = [
            msgspec.structs.replace(config, buses=(Bus(device="sim", legs={leg: 0}),))
            for bus in config.buses
            for leg in (*bus.legs, *bus.addresses)
        ]
        self._pipelines = [pipeline_for(load_models(alone), Flag.SIMULATED) for alone in single]
        self._counter = 0
        registry = CollectorRegistry()
        self._sent = Counter("frames", "Frames sent.", registry=registry)
        self._scans = Counter("scans", "Scans by state.", ["leg", "state"], registry=registry)
        self._state = Gauge("state", "State.", ["leg"], registry=registry)
        self._force = Gauge("force_newtons", "Force.", ["leg", "axis"], registry=registry)
        self._age = Histogram("age_seconds", "Age.", ["leg"], registry=registry)

    def run(self, scan: CapFrame, now_ns: int, channel: socket.socket, pipe: int) -> None:
        """Run one naive cycle on a frame: estimate, encode, send, count and record."""
        self._counter = (self._counter + 1) % 15
        record: dict[str, Any] = {"sequence": scan.sequence, "t_ns": now_ns}
        for row, leg in enumerate(self._legs):
            alone = slice(row, row + 1)
            own = CapFrame(scan.sequence, scan.t_ns[alone], scan.capacitance_pf[alone], scan.reading[alone])
            forces, _ = self._pipelines[row].process(own, now_ns)
            self._send(channel, f"Force{leg.capitalize()}", _force_signals(forces))
            self._send(channel, f"Quality{leg.capitalize()}", _quality_signals(forces))
            self._update_metrics(leg, forces)
            record[leg] = {
                "scan_t_ns": own.t_ns[0].tolist(),
                "capacitance_pf": own.capacitance_pf[0].tolist(),
                "reading": own.reading[0].tolist(),
                "t_ns": int(forces.t_ns[0]),
                "force_n": forces.force_n[0].tolist(),
                "sigma_n": forces.sigma_n[0].tolist(),
                "state": State(int(forces.state[0])).name,
            }
        os.write(pipe, json.dumps(record).encode() + b"\n")

    def _update_metrics(self, leg: str, forces: ContactFrame) -> None:
        """Update the metrics of one leg."""
        state = State(int(forces.state[0])).name.lower()
        self._scans.labels(leg=leg, state=state).inc()
        self._state.labels(leg=leg).set(int(forces.state[0]))
        self._age.labels(leg=leg).observe(float(forces.age_ns[0]) * 1e-9)
        for axis, force_n in zip("xyz", forces.force_n[0], strict=True):
            self._force.labels(leg=leg, axis=axis).set(float(force_n))

    def _send(self, channel: socket.socket, name: str, signals: dict[str, float]) -> None:
        """Encode a CAN message with cantools and send it."""
        message = self._database.get_message_by_name(name)
        values = {"CHECKSUM": 0, "COUNTER": self._counter, **signals}
        data = crc8.protect(message.frame_id, message.encode(values)[1:])
        frame = self._message(arbitration_id=message.frame_id, data=data, is_extended_id=False)
        channel.send(self._frame(frame))
        self._sent.inc()


def _force_signals(forces: ContactFrame) -> dict[str, float]:
    """Return the signals of a `Force` message."""
    force_n = np.nan_to_num(forces.force_n[0], nan=-32.768)
    axes = dict(zip(("ForceX", "ForceY", "ForceZ"), force_n.round(3).tolist(), strict=True))
    return {"State": int(forces.state[0]), **axes}


def _quality_signals(forces: ContactFrame) -> dict[str, float]:
    """Return the signals of a `Quality` message."""
    codes = np.ceil(8.0 * np.log2(np.maximum(forces.sigma_n[0], 1e-3) * 1e3))
    sigma_codes = np.nan_to_num(np.minimum(codes, 126.0), nan=127.0).astype(int)
    flags = Flag(int(forces.flags[0]))
    return {
        "Simulated": int(Flag.SIMULATED in flags),
        "DegradedTiming": int(Flag.DEGRADED_TIMING in flags),
        "TareRefused": int(Flag.TARE_REFUSED in flags),
        "Contact": int(Flag.CONTACT in flags),
        "Age": float(forces.age_ns[0]) * 1e-6,
        **dict(zip(("SigmaX", "SigmaY", "SigmaZ"), sigma_codes.tolist(), strict=True)),
        "ContactProbability": float(np.nan_to_num(forces.contact_probability[0], nan=1.27)),
        "Holds": float(np.nan_to_num(forces.holds[0], nan=1.27)),
    }
