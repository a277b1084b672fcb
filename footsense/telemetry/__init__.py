"""Metrics in shared memory and their exporter, log messages, systemd notification, run statistics."""
