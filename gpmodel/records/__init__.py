"""Records of a running search on disk."""
