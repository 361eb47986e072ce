"""Formulas: operators, expressions over named columns, and evolved programs."""
