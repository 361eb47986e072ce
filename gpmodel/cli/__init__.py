"""The command line, a thin last layer."""
