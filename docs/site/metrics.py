"""Every metric of the service, from what the exporter shows of a simulated one."""

import msgspec
from docstrings import table

from footsense.config import DEFAULT
from footsense.daemon.service import open_service
from footsense.ports import WakeupLatency
from footsense.sim.scene import load_scene
from footsense.telemetry.electrodes import ElectrodesSeen, electrode_metrics
from footsense.telemetry.feet import Odometer, identity_metrics
from footsense.telemetry.metrics import ServiceMetrics

_ELECTRODES = {"of": {"leg": "lf"}, "turn_deg": 0.0, "turn_sigma_deg": 0.0, "objection": ""}


def markdown() -> str:
    """Return a table of all metrics."""
    metrics = ServiceMetrics(DEFAULT.legs)
    with open_service(DEFAULT, load_scene("hanging"), real_time=False) as service:
        service.wakeups = (WakeupLatency(),)
        is_complete = False
        while not is_complete:  # some cycles have no gait
            scan = service.source.read()
            assert scan is not None
            cycle = service.run_cycle(scan, ())
            metrics.add(cycle)
            is_complete = cycle.forces.gait is not None
        metrics.status = service.status()
    rows: list[list[object]] = []
    odometer = Odometer()
    odometer.begin({"scene": "{}"}, DEFAULT.legs)
    of_feet = [*identity_metrics({}, DEFAULT.legs), *odometer.collect()]
    electrodes = electrode_metrics([msgspec.convert(_ELECTRODES, ElectrodesSeen)])
    for family in (*metrics.collect(), *of_feet, *electrodes):
        labels = ", ".join(f"`{label}`" for label in family.samples[0].labels if label != "le")
        name = f"{family.name}_total" if family.type == "counter" else family.name
        rows.append([f"`{name}`", family.type, labels, family.documentation])
    return table(["metric", "type", "labels", "meaning"], rows)
