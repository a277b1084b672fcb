"""A simulated EEPROM, in the place of a converter."""


class Eeprom:
    """Simulated 24C02: reads and writes advance a pointer; each byte initially holds its own address."""

    def __init__(self) -> None:
        self._pointer = 0
        self._memory = bytearray(range(256))

    def write(self, data: bytes) -> None:
        """Receive a pointer, and the bytes from there on."""
        self._pointer = data[0]
        for value in data[1:]:
            self._memory[self._pointer] = value
            self._pointer = (self._pointer + 1) % 256

    def read(self, n: int) -> bytes:
        """Return `n` bytes from the pointer on."""
        return bytes(self._memory[(self._pointer + k) % 256] for k in range(n))
