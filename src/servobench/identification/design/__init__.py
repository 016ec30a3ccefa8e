"""The experiment with the smallest interval under limits on voltage, current, speed, travel and time, and the intervals to
expect."""
