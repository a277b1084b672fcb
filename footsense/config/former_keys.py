"""Renamed configuration keys: refused in a YAML file with the present name, still read in a recording."""

_PRESENT_NAME_OF_KEY = {
    "zero": "baseline",
    "packs": "calibrations",
    "touch_n": "threshold_n",
    "window_frames": "window_scans",
}

#: Keys of earlier versions, each with what replaces it.
REPLACEMENT_OF_FORMER_KEY = {key: f"now called {name}" for key, name in _PRESENT_NAME_OF_KEY.items()} | {
    "average_scans": "forces are no longer averaged; take this key away, and average at the receiver",
    "publish": "now called publish_every: conversions per force on CAN, 4 by default and 1 for each conversion",
    "gang": "the column-sum scan was removed; take this key away",
}

#: Recorded forces are compared frame by frame, whatever was published of them.
_REMOVED_SETTINGS_WITHOUT_EFFECT = (
    ("gang", False),
    ("average_scans", 1),
    ("publish", "frame"),
    ("publish", "element"),
)


def with_present_keys(data: object) -> object:
    """Return a recorded configuration with renamed keys updated, and removed keys without effect dropped."""
    if isinstance(data, dict):
        items = (
            (key, value)
            for key, value in data.items()
            if (key, value) not in _REMOVED_SETTINGS_WITHOUT_EFFECT
        )
        return {_PRESENT_NAME_OF_KEY.get(key, key): with_present_keys(value) for key, value in items}
    return data
