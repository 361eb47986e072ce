"""Operators, expressions over named columns, and evolved programs."""
