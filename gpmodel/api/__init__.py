"""Public functions and result classes of the package; `gpmodel` exports all of them."""
