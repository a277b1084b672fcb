"""Counters in shared memory and their exporter, the journal, systemd, and run statistics."""
