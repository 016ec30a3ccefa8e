"""Stability: poles, the verdict and an input that shows it, closed loops, and what a record or an interval leaves open."""
