"""Speeds computed from an encoder's counts: their noise, their lag, and the effect of both on a time constant read off them."""
