"""Speed beside its limits: scan, cycle, wake-up latency, each with its floor in the same run."""
