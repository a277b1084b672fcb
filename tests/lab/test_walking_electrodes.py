"""What a foot gains that finds its electrodes while it walks, by the command's own figures."""

import pytest

from footsense.lab.studies.boards.walking_electrodes import as_markdown, walking_figures

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("case", "least_deg", "share"),
    [("as made, not calibrated", 4.5, 0.2), ("drifted, elements creep apart by 1 %", 2.0, 0.7)],
)
def test_a_minute_of_walking_finds_electrodes(case: str, least_deg: float, share: float) -> None:
    figures = walking_figures(1, [case])
    (foot,) = figures[case]
    assert foot["before_deg"] > least_deg
    assert foot["60 s"]["after_deg"] < share * foot["before_deg"]
    assert foot["60 s"]["within_2_sigma"] > 0.9
    assert f"{foot['before_deg']:.2f}" in as_markdown(figures)
