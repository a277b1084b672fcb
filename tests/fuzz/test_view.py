"""What `footsense view` reads of whoever connects: messages and headers."""

import json

from hypothesis import given
from hypothesis import strategies as st

from footsense.view.http_answers import is_allowed_origin, is_own_host
from footsense.view.page_session import Request, decode_request
from tests.fuzz.outcome import TRIED, refusal
from tests.fuzz.test_texts import anything


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
