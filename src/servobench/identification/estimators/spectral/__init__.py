"""Frequency response from records: lines of the spectrum, local fits around them, and readings off the points."""
