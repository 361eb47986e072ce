"""Precision spherical joints: the joint as a mechanism, and the models it is designed with."""
