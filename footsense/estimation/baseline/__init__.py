"""What each element reads unloaded: tare, drift, and contact detection."""
