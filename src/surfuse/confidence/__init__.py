"""Validation and the three degrees of confidence of the paper."""
