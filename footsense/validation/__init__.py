"""The daemon under faults in virtual time: fault table, random faults, soak, invariants, virtual experiment."""
