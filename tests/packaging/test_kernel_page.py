"""The trials on a real kernel, without running them: the page whose commands they execute."""

import re

from tests.kernel import deploy_page


def test_every_block_of_the_page_is_executed() -> None:
    """A command that is prepared for is still on the page."""
    page = deploy_page.PAGE.read_text(encoding="utf-8")
    for words in deploy_page.BEFORE:
        assert re.search(rf"^{re.escape(words)}", page, re.MULTILINE), words
    blocks = re.findall(r"^```sh\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines() if line]
    executed = "\n".join(command.text for command in deploy_page.commands()).splitlines()
    assert lines == executed
