"""Frequency response from records: lines of the spectrum, local fits around them, what is read off the points."""
