"""States of the poses, effects, and the error model of a mechanism with its observations."""
