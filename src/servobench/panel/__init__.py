"""The front panel: a page in a browser from which a motor is driven, seen, recorded and identified."""
