"""Where results go: CAN, counters in shared memory and their exporter, systemd, the journal."""
