"""The queries of alerts and dashboard ask for metrics that the exporter has, by labels that these have."""

import json
import re
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[3]
#: Metric with its labels in the reference, which is generated from the code, and in a query.
_ROW = re.compile(r"^\| `(footsense_\w+)` \| (\w+) \| (.*?) \|", re.MULTILINE)
_SERIES = re.compile(r"(footsense_\w+)(?:\{([^}]*)\})?")
_LABEL = re.compile(r"(\w+)(?:=~|!~|!=|=)\"")
METRICS = {
    f"{name}_bucket" if kind == "histogram" else name: set(re.findall(r"`(\w+)`", labels))
    for name, kind, labels in _ROW.findall((ROOT / "docs/reference/metrics.md").read_text())
} | {"footsense_up": set()}


def _alerts() -> list[str]:
    rules = yaml.safe_load((ROOT / "deploy/prometheus/alerts.yaml").read_text())["groups"][0]["rules"]
    return [rule["expr"] for rule in rules]


def _dashboard() -> list[str]:
    dashboard = json.loads((ROOT / "deploy/grafana/footsense.json").read_text())
    variables = [one["query"] for one in dashboard["templating"]["list"] if one["type"] == "query"]
    return variables + [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


def test_every_query_names_metrics_and_labels_that_are_exported() -> None:
    for query in (*_alerts(), *_dashboard()):
        series = _SERIES.findall(query)
        assert series, query
        for name, labels in series:
            assert name in METRICS, query
            assert set(_LABEL.findall(labels)) <= METRICS[name], query


def test_the_panels_of_the_dashboard_do_not_overlap() -> None:
    panels = json.loads((ROOT / "deploy/grafana/footsense.json").read_text())["panels"]
    places = [panel["gridPos"] for panel in panels]
    taken = [
        (x, y)
        for place in places
        for x in range(place["x"], place["x"] + place["w"])
        for y in range(place["y"], place["y"] + place["h"])
    ]
    assert len(taken) == len(set(taken))
    assert all(0 <= x < 24 for x, _ in taken)
    assert len({panel["id"] for panel in panels}) == len(panels)
