"""Read the feet: from converter chips or a microcontroller to `CapFrame`; simulation uses the same drivers."""
