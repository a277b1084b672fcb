"""Configurations, scenes, the configuration in a recording's header, and what a browser says to `footsense view`."""

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.config import SMALL_BOARD, load_config
from footsense.daemon.recording_header import recorded_config, recorded_flags, recorded_start
from footsense.recording.mcap_writer import McapFile
from footsense.recording.replay import Replay
from footsense.sim.scene import load_scene
from footsense.view.http_answers import is_allowed_origin, is_own_host
from footsense.view.page_session import Request, decode_request
from tests.fuzz.outcome import TRIED, anything, refusal

ROBOT = "buses: [{device: sim, legs: {lf: 0, rf: 1}}]\ncan: {interface: virtual}\n"
SCENE = "description: x\nload: {kind: tripod, period_s: 1.0, peak_force_n: [0, 0, 1]}\nseed: 3\n"

words = "buses: legs: load: seed: !!python/object:os.system ? | > 1e999 .nan -.inf 1:2:3 2020-01-01 ~"
parts = [
    "{lf: 0}",
    "kind: tripod",
    "- ",
    "&a ",
    "*a",
    "<<: ",
    "---\n",
    "...\n",
    "%YAML 1.1\n",
    "9" * 5000,
    "\x00",
    "\ufeff",
    "\u2028",
    "\n  ",
]
pieces = st.sampled_from([*words.split(), *parts, *"\n :{}[],'\"#"])
texts = st.text(max_size=60) | st.lists(pieces, max_size=25).map("".join)


@given(data=st.data(), text=texts)
@TRIED
def test_any_yaml(tmp_path: Path, data: st.DataObject, text: str) -> None:
    """Any text, alone and inside a configuration or scene that is right."""
    for whole, read in ((ROBOT, load_config), (SCENE, lambda file: load_scene(str(file)))):
        at = data.draw(st.integers(0, len(whole)))
        cut = data.draw(st.integers(at, len(whole)))
        for content in (text, whole[:at] + text + whole[cut:]):
            file = tmp_path / "file.yaml"
            file.write_bytes(content.encode(errors="surrogatepass"))
            refusal(lambda read=read, file=file: read(file))  # type: ignore[misc]


LEVELS = "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))


@pytest.mark.parametrize(
    "text",
    [
        "a0: &a0 [1]\n" + LEVELS,
        "[" * 250_000,
        "{a: " * 60_000,
        "- " * 130_000,
        "seed: " + "9" * 200_000,
        "seed: 1e" + "9" * 10_000,
        "? " * 130_000,
        "x: " + "'" * 200_000,
        "\n".join(f"k{n}: {n}" for n in range(9_000)),
    ],
)
def test_bombs(tmp_path: Path, text: str) -> None:
    """Aliases that multiply, nesting and numbers without end, and more keys than anyone writes."""
    file = tmp_path / "file.yaml"
    file.write_text(text)
    assert refusal(lambda: load_scene(str(file)))
    assert refusal(lambda: load_config(file))


CONFIG: dict[str, Any] = json.loads(msgspec.json.encode(SMALL_BOARD))


@given(
    key=st.sampled_from(sorted(CONFIG)),
    value=anything,
    text=st.text(max_size=30),
    flags=st.text(max_size=6) | st.sampled_from(["-1", "256", "9" * 5000, "\u0663"]),
)
@TRIED
def test_any_recorded_configuration(tmp_path: Path, key: str, value: object, text: str, flags: str) -> None:
    """The header of a recording may say anything."""
    for config in (json.dumps({**CONFIG, key: value}), text, "[" * 50_000):
        path = tmp_path / "walk.mcap"
        with path.open("wb") as file:
            McapFile(
                file.fileno(), {"legs": "lf", "config": config, "flags": flags, "started": flags}
            ).finish()
        refusal(lambda path=path: recorded_config(Replay(path)))  # type: ignore[misc]
        refusal(lambda path=path: recorded_flags(Replay(path)))  # type: ignore[misc]
        refusal(lambda path=path: recorded_start(Replay(path)))  # type: ignore[misc]
    path.unlink()


@given(
    st.text(max_size=60)
    | st.binary(max_size=60)
    | anything.map(json.dumps)
    | st.builds(
        lambda kind, key, value: json.dumps({"type": kind, key: value}),
        st.sampled_from(["drawn", "chunk", "x"]),
        st.sampled_from(["number", "x"]),
        anything,
    )
)
@TRIED
def test_any_message_of_a_page(message: str | bytes) -> None:
    """A request, or a `ValueError`, by which the server dismisses the page."""
    refused = refusal(lambda: decode_request(message), ValueError)
    assert refused is not None or isinstance(decode_request(message), Request)


@given(
    st.text(max_size=30) | st.sampled_from(["[", "[::1", "127.0.0.1:x", "robot@evil", "//", "1.2.3.4:99999"])
)
@TRIED
def test_any_host_and_origin(header: str) -> None:
    """A name that is not ours never is, whatever the header looks like."""
    is_own_host(header, ["localhost"])
    assert not is_own_host(f"x{header.replace('.', '').replace(':', '')}", ["localhost"])
    assert is_allowed_origin(header, "127.0.0.1:8765") == (
        header in {f"http{s}://127.0.0.1:8765" for s in ("", "s")}
    )
