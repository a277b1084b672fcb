"""Runs the shell commands that arrive on a virtio port, one JSON object a line, and answers each with one.

Commands run side by side, so that a trial can watch something while it does another thing.
"""

import json
import subprocess
import sys
import threading
import time
from typing import Any, BinaryIO

_writing = threading.Lock()


def answer(port: BinaryIO, asked: dict[str, Any]) -> None:
    """Run one command and write its exit code, its output, and when it ended."""
    try:
        done = subprocess.run(
            ["bash", "-c", asked["command"]],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=asked["timeout_s"],
            check=False,
        )
        code, output = done.returncode, done.stdout
    except subprocess.TimeoutExpired as expired:
        code, output = 124, expired.stdout or b""
    text = output.decode(errors="replace")
    reply = {"id": asked["id"], "code": code, "output": text, "t_s": time.time()}
    data = json.dumps(reply).encode() + b"\n"
    with _writing:
        while data:
            data = data[port.write(data) :]


def main() -> None:
    """Serve until the machine goes down."""
    with open(sys.argv[1], "r+b", buffering=0) as port:  # noqa: PTH123
        rest = b""
        while True:
            read = port.read(65536)
            if not read:  # nobody has the other end open
                time.sleep(0.2)
                continue
            *lines, rest = (rest + read).split(b"\n")
            for line in filter(None, lines):
                threading.Thread(target=answer, args=(port, json.loads(line)), daemon=True).start()


if __name__ == "__main__":
    main()
