"""Keys of earlier versions: refused in a YAML file with the present name, read in a recording."""

_RENAMED = {
    "zero": "baseline",
    "packs": "calibrations",
    "touch_n": "threshold_n",
    "window_frames": "window_scans",
}

#: Keys of earlier versions, each with what replaces it.
FORMER_KEYS = {key: f"now called {name}" for key, name in _RENAMED.items()} | {
    "gang": "the column-sum scan was removed; take this key away",
}


def with_present_keys(data: object) -> object:
    """Return a recorded configuration with its keys renamed, and without `gang: false`."""
    if isinstance(data, dict):
        items = ((key, value) for key, value in data.items() if (key, value) != ("gang", False))
        return {_RENAMED.get(key, key): with_present_keys(value) for key, value in items}
    return data
