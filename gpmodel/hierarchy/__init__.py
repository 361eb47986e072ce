"""Many machines of one type: what they share, how they spread, and which of them is no part of it."""
