"""Interface between the engine and a mechanism, and the providers of mechanisms."""
