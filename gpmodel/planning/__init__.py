"""Selection of measurement poses, and simulation of measured tables with known errors."""
