"""Simulated TCA9548A I2C mux between an upstream bus and the legs.

Source:
    TCA9548A data sheet SCPS207, sections 8.4.1 (RESET input) and 8.5.4 (selection at STOP).
"""


class SimulatedMux:
    """Simulated TCA9548A I2C mux: the last byte written selects its channels, effective at STOP.

    Args:
        address: Address on the bus.

    Attributes:
        address: As given.
        control: Control register: bit k connects channel k.
    """

    def __init__(self, address: int) -> None:
        self.address = address
        self.control = 0

    def acknowledges(self, t_ns: int) -> bool:
        """Return True: the mux always acknowledges."""
        del t_ns
        return True

    def write(self, data: bytes, t_ns: int) -> None:
        """Store the control byte (one bit per connected channel); called at STOP, when it takes effect."""
        del t_ns
        self.control = data[-1]

    def pulse(self) -> None:
        """Disconnect all channels, as a pulse on the RESET pin does."""
        self.control = 0

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the mux's control byte, `n` times."""
        del t_ns
        return bytes((self.control,)) * n
