"""The file that describes a test stand: what is right is read, what is wrong is one line."""

from pathlib import Path

import pytest

from footsense.config.test_stand import SerialSensor, SimulatedSensor, load_test_stand
from footsense.errors import ConfigError

DEPLOY = Path(__file__).parents[3] / "deploy"

SERIAL = """
sensor:
  kind: serial
  device: /dev/ttyUSB0
  rate_hz: 200
  columns: [time_us, fx, fy, fz]
units: kgf
rated: [4, 4, 8]
axes: {x: -x, y: -y, z: -z}
"""


def test_the_files_that_come_with_footsense_are_right() -> None:
    """Both load; the simulated one is for the simulated sensor."""
    assert isinstance(load_test_stand(DEPLOY / "test-stand.yaml").sensor, SerialSensor)
    assert isinstance(load_test_stand(DEPLOY / "test-stand-simulated.yaml").sensor, SimulatedSensor)


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ("y: -y", "y: -x", ":9: axes: -x, -x, -z names an axis of the sensor twice"),
        ("kgf", "kg", "units: 'kg' is none of N, gf, kgf, lbf, mN; did you mean kgf?"),
        ("[time_us, fx, fy, fz]", "[time_us, fx, fy, '-']", "sensor.columns: no column is fz"),
        ("[time_us, fx, fy, fz]", "[fx, fx, fy, fz]", "sensor.columns: name one thing twice"),
        ("[time_us, fx", "[time_us, time_ms, fx", "sensor.columns: name one thing twice"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, right: str, wrong: str, says: str) -> None:
    """With the place and what would be right."""
    path = tmp_path / "test-stand.yaml"
    assert right in SERIAL
    path.write_text(SERIAL.replace(right, wrong))
    with pytest.raises(ConfigError) as raised:
        load_test_stand(path)
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)
