"""Files that record the finished parts of a running search."""
