"""Machines of one type: their common mean, the spread between machines, and outlying machines."""
