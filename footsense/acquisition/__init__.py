"""From converter codes to `CapFrame`: boards, transports, scanner; hardware and simulation share the drivers."""
