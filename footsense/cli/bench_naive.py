"""The yardstick of `footsense bench`: the same work as a straightforward program does it.

It scans leg by leg and element by element, waits for each conversion, infers leg by leg, looks signals up by name to
encode them with cantools, and builds every CAN message anew. Nothing of the daemon uses this.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import onnxruntime as ort

from firmware_interface import tca9548a
from footsense.config import Config
from footsense.drivers.fdc1004 import READ_CONF
from footsense.drivers.scan_plan import scan_plan
from footsense.frames import CapFrame
from footsense.inference.network import Network
from footsense.ports import Clock, I2cBus, Transaction


def sequential_scan(bus: I2cBus, clock: Clock, config: Config) -> None:
    """Scan every element of every leg of the first bus, one after the other."""
    plan = scan_plan("raster", config.scan.rate_sps)
    for channel in config.buses[0].legs.values():
        for step in plan.steps:
            bus.transfer(Transaction(config.buses[0].mux.address, bytes((tca9548a.select((channel,)),))))
            bus.transfer(step.select_row)
            bus.transfer(step.trigger)
            clock.sleep_until_ns(clock.now_ns() + plan.wait_ns)
            bus.transfer(READ_CONF)
            for read in step.read:
                bus.transfer(read)


def naive_cycle(
    network: Network,
    model: bytes,
    baseline_pf: np.ndarray,
    legs: tuple[str, ...],
    database: Any,  # noqa: ANN401
) -> Callable[[CapFrame], None]:
    """Return a function that makes CAN messages of one scan and sends them, without a thought for time.

    Args:
        network: Whose card says how to normalise.
        model: The same network's file.
        baseline_pf: Unloaded capacitance [pF], shape (legs, 9).
        legs: Names of the legs.
        database: The DBC, loaded by cantools.
    """
    import can

    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    bus = can.Bus(interface="virtual", channel="naive")
    card = network.card
    design = card.calibration.design
    counter = 0

    def cycle(scan: CapFrame) -> None:
        nonlocal counter
        counter = (counter + 1) % 15
        for row, leg in enumerate(legs):
            closure = design.closure_um(scan.capacitance_pf[row], baseline_pf[row]) / design.gap_um
            [force] = session.run(None, {card.input.name: closure[None].astype(np.float32)})
            values = {"COUNTER": counter, "CHECKSUM": 0}
            for kind in ("Force", "Quality"):
                message = database.get_message_by_name(f"{kind}{leg.capitalize()}")
                fields = {signal.name: 0 for signal in message.signals} | values
                if kind == "Force":
                    fields |= dict(
                        zip(("ForceX", "ForceY", "ForceZ"), force[0].round(3).tolist(), strict=True)
                    )
                data = message.encode(fields, scaling=True, strict=False)
                bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))

    return cycle
