"""Public functions and result classes of the package, all importable from `gpmodel`."""
