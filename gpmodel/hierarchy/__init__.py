"""Machines of one type: their common mean, the spread between them, and outlying machines."""
