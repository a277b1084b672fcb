"""Speed beside its limits: scan, cycle and wake-up latency; studies of latency against error."""
