"""The discovery loop: from a residual to named and tested effects."""
