"""Selection of groups of error effects by marginal likelihood."""
