"""The ring: the last 30 s of the loop's cycles in shared memory, one encoding of a cycle, and its one reader."""
