"""Exception classes of footsense, with their exit codes.

    FootsenseError            exit 1   a check failed, or a reason no other class names
    ├── ConfigError           exit 78  a key is unknown, a value is out of range, two settings clash
    ├── RecordingError        exit 74  not a recording, or cut short: what is whole was still replayed
    ├── ModelError            exit 66  a model is missing, corrupt, or made for another foot
    ├── HardwareError         exit 69  the bus or a chip that everything needs is not there
    │   ├── ReferenceSensorError   a test stand's force sensor does not match its description
    │   ├── WrongChipError             another chip answers; the scanner turns it into a state, as the next ones
    │   └── I2cError                   one transaction failed
    │       ├── NackError              nobody acknowledged the address or a byte
    │       └── I2cTimeoutError        the adapter gave up: a line is held low
    ├── CanError              exit 71  the CAN channel is not there or is down
    └── CalibrationError      exit 65  a foot's recordings are inconsistent or not sufficient

The message of an error is one line for a person: what is wrong, where, and what would be right.
Only `footsense.cli` turns an error into an exit code: those of sysexits.h, which systemd shows by name. The labels of
systemd itself begin at 2, where `5` is NOTINSTALLED. A wrong command line ends with click's 2.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec


def printable_line(text: str) -> str:
    """Return a text as one line without control characters."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(text.split()))


#: Characters of a message that are shown; a longer one, which quotes a file, is cut in the middle.
_BEGIN, _END = 800, 150


class FootsenseError(Exception):
    """Base class of all expected errors; the message is one line of text for the user."""

    exit_code = 1

    def __str__(self) -> str:
        """Return the message as one line without control characters, of a bounded length."""
        line = printable_line(super().__str__())
        return line if len(line) <= _BEGIN + _END else f"{line[:_BEGIN]} ... {line[-_END:]}"


class ConfigError(FootsenseError):
    """A configuration or scene violates its schema or contradicts itself."""

    exit_code = 78


class RecordingError(FootsenseError):
    """A recording cannot be read, or cannot be read to its end."""

    exit_code = 74


class ModelError(FootsenseError):
    """A network or response table cannot be used for the given feet."""

    exit_code = 66


class HardwareError(FootsenseError):
    """A bus or chip without which the service cannot run is missing."""

    exit_code = 69


class ReferenceSensorError(HardwareError):
    """The reference force sensor of a test stand is missing, or its data do not match its description."""


class WrongChipError(HardwareError):
    """A chip other than the expected one answers at its I2C address."""


class I2cError(HardwareError):
    """An I2C transaction failed; its data are invalid."""


class NackError(I2cError):
    """A chip did not acknowledge its I2C address or a byte: absent, unpowered, or at another address."""


class I2cTimeoutError(I2cError):
    """An I2C transaction timed out: SDA or SCL is held low."""


class CanError(FootsenseError):
    """The CAN interface is missing or down."""

    exit_code = 71


class CalibrationError(FootsenseError):
    """The recordings of a foot are inconsistent or insufficient for a calibration."""

    exit_code = 65


def install_line(extra: str) -> str:
    """Return what installs an extra of footsense, which is on no index: it is installed from its clone."""
    return f"in the clone of footsense: pip install -e deploy/client -e '.[{extra}]'"


@contextmanager
def serving_errors(what: str, section: str, address: str, port: int) -> Iterator[None]:
    """Explain why something cannot be served on an address and port of a section of the configuration.

    Raises:
        ConfigError: The port is in use or needs privileges, or the address is not of this machine.
    """
    try:
        yield
    except OSError as error:
        code = error.errno or 0
        remedy = f"{section}.address has to be an address of this machine, such as 127.0.0.1"
        if code in {errno.EADDRINUSE, errno.EACCES}:
            remedy = f"choose another port: --port, or {section}.port"
        # A name that is not found has a negative number, which is none of the system's.
        why = os.strerror(code) if code > 0 else error.strerror or str(error)
        raise ConfigError(f"{what} cannot be served on {address}:{port}: {why}; {remedy}") from error


def require(user: str, extra: str, *packages: str, note: str = "") -> None:
    """Raise an error that names the extra of footsense to install, unless some packages are installed.

    Args:
        user: What needs them, such as an option.
        extra: The extra that has them.
        packages: Their names.
        note: More for the end of the message.

    Raises:
        FootsenseError: One is missing.
    """
    if missing := [name for name in packages if find_spec(name) is None]:
        raise FootsenseError(f"{user} needs {', '.join(missing)}; {install_line(extra)}{note}")
