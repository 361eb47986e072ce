"""Physical effects by name."""
