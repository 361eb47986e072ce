"""Selection of groups of effects by marginal likelihood."""
