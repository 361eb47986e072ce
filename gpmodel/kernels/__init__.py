"""The compiled inner loops; the only modules that import numba. NumPy twins in the tests are their oracle."""
