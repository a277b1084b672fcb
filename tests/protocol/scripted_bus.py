"""A bus that follows a script of (transaction, answer), as read off the data sheet."""

from types import TracebackType
from typing import Self

from footsense.ports import Transaction


class ScriptedBus:
    """Answers each expected transaction in turn; anything else, or a script not finished, fails the test.

    An answer that is an exception is raised.
    """

    def __init__(self, *script: tuple[Transaction, bytes | Exception]) -> None:
        self._script = list(script)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            assert self._script == [], "transactions that never came"

    def transfer(self, transaction: Transaction) -> bytes:
        expected, answer = self._script.pop(0)
        assert transaction == expected
        if isinstance(answer, Exception):
            raise answer
        return answer
