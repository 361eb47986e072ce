"""The public functions and what they return; `gpmodel` itself offers them all."""
