"""Tests of the daemon under faults in virtual time: fault table, random faults, soak test, virtual experiment."""
