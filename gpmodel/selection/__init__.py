"""Groups of effects chosen together by marginal likelihood."""
