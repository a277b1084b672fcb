"""Who answers on a bus, and what the feet read, before anything is scanned."""
