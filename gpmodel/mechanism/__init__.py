"""What the engine needs to know of a mechanism, and where mechanisms come from."""
