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


def test_the_page_of_the_blank_card_installs_as_the_page_that_is_executed() -> None:
    """Its commands stand there too, in the same order; it is at the top of the checkout, and that one in `deploy`."""
    card = (deploy_page.ROOT / "docs" / "raspberry-pi.md").read_text(encoding="utf-8")
    section = card.partition("\n## 3. ")[2].partition("\n## ")[0]
    block = re.findall(r"^```\w+\n(.*?)^```", section, re.DOTALL | re.MULTILINE)[0]
    opt = "/opt/footsense"
    wanted = [line.split("#")[0].strip() for line in block.splitlines() if opt in line]
    page = deploy_page.PAGE.read_text(encoding="utf-8")
    page = page.replace("-r requirements.lock", "-r deploy/requirements.lock")
    page = page.replace("./client ..", "./deploy/client .")
    executed = [line.split("#")[0].strip() for line in page.splitlines() if opt in line]
    assert len(wanted) == 5
    assert [line for line in executed if line in wanted] == wanted
