"""Judging a measured table before anything is fitted to it."""
