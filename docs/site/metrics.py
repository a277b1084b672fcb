"""Every metric of the service, from the declarations that the exporter serves."""

from docstrings import table

from footsense.frames import LEGS
from footsense.telemetry.metric_families import service_metrics


def markdown() -> str:
    """Return a table of all metrics."""
    rows: list[list[object]] = []
    for family in service_metrics(LEGS, [0.001]):
        labels = ", ".join(f"`{label}`" for label in family.label_values)
        rows.append([f"`{family.name}`", family.metric_type, labels, family.help])
    return table(["metric", "type", "labels", "meaning"], rows)
