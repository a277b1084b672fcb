"""Benchmarks of scan period, cycle time and wake-up latency, and studies of latency against force error."""
