"""Elements that were converted one after the other, brought to one time."""
