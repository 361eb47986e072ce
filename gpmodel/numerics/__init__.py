"""Linear algebra, rigid motions and null distributions."""
