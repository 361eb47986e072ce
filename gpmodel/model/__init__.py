"""States, effects, and the error model made of them."""
