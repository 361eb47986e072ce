"""Selection of measurement poses, and simulated tables with known errors."""
