"""Speeds made of an encoder's counts: their noise, their lag, and what both do to a time constant that is read off them."""
