"""Machines of one type: mean parameters, the spread between machines, and outlying machines."""
