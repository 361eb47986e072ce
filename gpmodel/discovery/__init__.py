"""The loop: from a residual to effects that are named and proven."""
